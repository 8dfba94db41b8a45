"""Which twin is asked: a running server's or one made of a file; and the server's answers."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple

import click

from slowtime_services.client import AnswerError, Client, UnreachableError


class TwinQuery(NamedTuple):
    """A twin to be asked: a running server's, or one made here of a file."""

    source: Path | None
    server: str | None
    asset: str | None
    registration: Path | None
    events: Path | None
    changes: Literal["stiffness", "mass", "both"]
    nominal_hz: float | None
    nominal_damping: float | None
    learn_epochs: int


def without_none(given: dict[str, Any]) -> dict[str, Any]:
    """Return the entries that are not None."""
    return {name: value for name, value in given.items() if value is not None}


@contextlib.contextmanager
def server_errors_told() -> Iterator[None]:
    """Report in a sentence what a server refuses, or that it does not answer."""
    try:
        yield
    except (AnswerError, UnreachableError) as error:
        raise click.ClickException(str(error)) from error


def ask_server(
    asked: TwinQuery,
    method: str,
    what: str,
    *,
    query: dict[str, Any] | None = None,
    body: object = None,
) -> dict[str, Any]:
    """Ask a running twin server."""
    assert asked.server is not None
    try:
        client = Client(asked.server, timeout_s=120.0)
        return client.json(method, f"/twins/{asked.asset}/{what}", query, body)
    except (AnswerError, UnreachableError, ValueError) as error:
        raise click.UsageError(str(error)) from error

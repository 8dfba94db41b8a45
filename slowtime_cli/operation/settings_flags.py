"""Settings of a process that are given by flags rather than by its file of settings."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from slowtime_cli.shared.options import ROUTER, endpoints
from slowtime_services.documents.bounds import DocumentError


def given_settings(**settings: Any) -> dict[str, Any]:
    """Return the settings that are not None."""
    return {name: value for name, value in settings.items() if value is not None}


@contextlib.contextmanager
def naming_config(config: Path | None) -> Iterator[None]:
    """Name the file of settings in an error where it cannot be parsed."""
    try:
        yield
    except DocumentError as error:
        raise click.UsageError(f"--config {config}: {error}") from error


def endpoints_unless_configured(
    connect: tuple[str, ...], config: Path | None, credentials: Path | None
) -> tuple[str, ...] | None:
    """Return the endpoints of the flags; None where the file of settings decides."""
    left = config is not None and connect == (ROUTER,)
    return None if left else endpoints(connect, credentials)

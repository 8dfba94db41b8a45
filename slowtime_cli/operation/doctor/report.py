"""The verb `doctor`: runs the checks, and prints what they found."""

import dataclasses
import itertools
import json
from collections.abc import Iterable, Iterator
from pathlib import Path

import click

from . import installation, surroundings
from .findings import CheckLine

COLOURS = {"ok": "green", "note": "yellow", "problem": "red"}


def doctor(
    connect: tuple[str, ...],
    credentials: Path | None,
    server: str,
    mqtt: str | None,
    folder: Path,
    timeout_s: float,
    as_json: bool,
) -> int:
    """Run all checks; 1 where one of them found a problem."""
    found = tuple(checked(connect, credentials, server, mqtt, folder, timeout_s))
    if as_json:
        click.echo(json.dumps([dataclasses.asdict(one) for one in found], indent=2))
    else:
        print_findings(found)
    return int(any(one.state == "problem" for one in found))


def checked(
    connect: tuple[str, ...],
    credentials: Path | None,
    server: str,
    mqtt: str | None,
    folder: Path,
    timeout_s: float,
) -> Iterator[CheckLine]:
    """Run the checks one after the other."""
    yield from installation.versions()
    yield from installation.extras()
    yield from surroundings.router(connect, credentials, timeout_s)
    yield from surroundings.twin_server(server, timeout_s)
    if mqtt is not None:
        yield from surroundings.mqtt(mqtt, timeout_s)
    yield from surroundings.clock(timeout_s)
    yield from installation.write_access(folder)
    yield from installation.compiled_code()


def print_findings(found: Iterable[CheckLine]) -> None:
    """Print findings by groups, and the number of problems."""
    found = sorted(found, key=lambda one: GROUPS.index(one.group))
    for group, members in itertools.groupby(found, key=lambda one: one.group):
        click.echo(f"\n{group}")
        for one in members:
            state = click.style(f"{one.state:7}", fg=COLOURS[one.state])
            click.echo(f"  {state}  {one.name:<15}  {one.text}")
            if one.advice:
                click.echo(f"{'':28}→ {one.advice}")
    problems = sum(one.state == "problem" for one in found)
    notes = sum(one.state == "note" for one in found)
    click.echo(f"\n{_number(problems, 'problem')}, {_number(notes, 'note')}.")


GROUPS = (
    installation.VERSIONS,
    installation.EXTRAS,
    surroundings.NETWORK,
    surroundings.CLOCK,
    installation.WRITING,
)


def _number(count: int, what: str) -> str:
    return f"{count or 'No'} {what}{'' if count == 1 else 's'}"

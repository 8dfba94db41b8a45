"""How every verb reads a record, whatever wrote it."""

import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from slowtime_services.files import Record, find_column, read_record
from slowtime_services.replay import record_of

from .options import names
from .terminal import note

BINARY = (".mcap", ".npy", ".npz", ".mat")


def with_record(verb: Callable[..., Any]) -> Callable[..., Any]:
    """Hand a verb that takes `verbs.flags.RECORD` a `Record` in place of them."""

    @functools.wraps(verb)
    def reading(
        record_path: Path,
        rate_hz: float | None,
        channels: str | None,
        skip_lines: int | None,
        columns: str | None,
        time_column: str | None,
        **others: Any,
    ) -> Any:
        record = read_any(
            record_path,
            rate_hz,
            names(channels, "--channels"),
            skip_lines,
            names(columns, "--columns"),
            time_column,
        )
        for text in record.notes:
            note(text)
        return verb(record=record, path=record_path, **others)

    return reading


def read_any(
    path: Path,
    rate_hz: float | None = None,
    channels: tuple[str, ...] | None = None,
    skip_lines: int | None = None,
    columns: tuple[str, ...] | None = None,
    time_column: str | None = None,
) -> Record:
    """Read a record of any kind, a recording among them."""
    kind = path.suffix.lower()
    if kind in BINARY and skip_lines:
        note(f"--skip-lines was not used: a {kind} file has no lines.")
    if kind == ".mcap":
        if time_column is not None:
            note("--time-column was not used: an MCAP recording carries its own clock.")
        return _as_told(record_of(path), path, rate_hz, channels, columns)
    return read_record(
        path,
        rate_hz=rate_hz,
        channels=channels,
        skip_lines=skip_lines,
        columns=columns,
        time_column=time_column,
    )


def _as_told(
    record: Record,
    path: Path,
    rate_hz: float | None,
    channels: tuple[str, ...] | None,
    columns: tuple[str, ...] | None,
) -> Record:
    """Let flags overrule what a recording says of itself, as they do for other files."""
    if columns is not None:
        if len(columns) != len(record.channels):
            raise click.UsageError(
                f"--columns gives {len(columns)} names, {', '.join(columns)}; {path} has "
                f"{len(record.channels)} channels, {', '.join(record.channels)}. Give one each."
            )
        record = dataclasses.replace(record, channels=columns)
    if rate_hz is not None and abs(rate_hz / record.rate_hz - 1) > 1e-3:
        note(f"{path.name} says {record.rate_hz:g} Hz; {rate_hz:g} Hz was given, and used.")
        record = dataclasses.replace(record, rate_hz=rate_hz)
    if channels is None:
        return record
    kept = [find_column(name, record.channels) for name in channels]
    if len(set(kept)) != len(kept):
        raise click.UsageError(f"--channels {','.join(channels)} names one twice.")
    return dataclasses.replace(
        record,
        samples=record.samples[:, kept],
        channels=tuple(record.channels[column] for column in kept),
        units=tuple(record.units[column] for column in kept),
    )

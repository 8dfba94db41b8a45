"""Records of any kind as verbs read them."""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from slowtime_services.files import ReadingOptions, Record, find_column, in_si, read_record
from slowtime_services.files.integrity import with_checked_values
from slowtime_services.replay import record_or_foreign

from .declared import gathered
from .terminal import note

BINARY_SUFFIXES = (".mcap", ".npy", ".npz", ".mat")


TEXT_FLAGS = ("time_column", "time_unit", "date_order", "wrapped", "keep")
"""Flags that say nothing of a recording, which names its channels and carries its clock."""


def with_record(verb: Callable[..., Any]) -> Callable[..., Any]:
    """Read the record of the options `verbs.flags.RECORD`, and a second, for a verb."""

    @functools.wraps(verb)
    def reading(record_path: Path, **flags: Any) -> Any:
        given = gathered(ReadingOptions, flags)
        record = read_any(record_path, given)
        note_reading(record)
        if flags.get("second") is not None:
            flags["second"] = read_any(flags["second"], given)
            note_reading(flags["second"])
        return verb(record=record, path=record_path, **flags)

    return reading


def note_reading(record: Record) -> None:
    """Print on one line how a file was read, and the assumptions made."""
    for text in record.notes:
        note(text)
    if record.assumptions:
        note(f"assumed: {'; '.join(record.assumptions)}.")


def read_any(path: Path, given: ReadingOptions | None = None) -> Record:
    """Read a record of any kind, a recording among them."""
    given = given or ReadingOptions()
    kind = path.suffix.lower()
    if kind in BINARY_SUFFIXES and given.skip_lines:
        note(f"--reading skip_lines was not used: a {kind} file has no lines.")
    if kind == ".mcap":
        for name in TEXT_FLAGS:
            if getattr(given, name) not in (None, ()):
                note(
                    f"--reading {name} was not used: an MCAP recording carries its own clock "
                    "and names."
                )
        record = overridden_by_flags(record_or_foreign(path), path, given)
        return with_checked_values(record, path.name, given.repeated)
    return read_record(
        path,
        **{one.name: getattr(given, one.name) for one in dataclasses.fields(given)},
        skip_missing=True,
    )


def overridden_by_flags(record: Record, path: Path, given: ReadingOptions) -> Record:
    """Let flags overrule what a recording states, as for other files."""
    rate_hz, channels, columns = given.rate_hz, given.channels, given.columns
    if columns is not None:
        if len(columns) != len(record.channels):
            raise click.UsageError(
                f"--reading columns gives {len(columns)} names, {', '.join(columns)}; {path} "
                "has "
                f"{len(record.channels)} channels, {', '.join(record.channels)}. Give one each."
            )
        record = dataclasses.replace(record, channels=tuple(columns))
    if rate_hz is not None and abs(rate_hz / record.rate_hz - 1) > 1e-3:
        note(f"{path.name} states {record.rate_hz:g} Hz; {rate_hz:g} Hz was given and is used.")
        record = dataclasses.replace(record, rate_hz=rate_hz)
    if channels is not None:
        record = _chosen(record, channels)
    return in_si(record, given.units, given.sensitivities)


def _chosen(record: Record, channels: Sequence[str]) -> Record:
    kept = [find_column(name, record.channels) for name in channels]
    if len(set(kept)) != len(kept):
        raise click.UsageError(f"--channels {','.join(channels)} names one twice.")
    return dataclasses.replace(
        record,
        samples=record.samples[:, kept],
        channels=tuple(record.channels[column] for column in kept),
        units=tuple(record.units[column] for column in kept),
    )

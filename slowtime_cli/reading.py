"""The flags with which every verb reads a record, whatever wrote it."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from slowtime_services.files import Record, read_record
from slowtime_services.replay import record_of

FLAGS = (
    click.option(
        "--rate-hz",
        type=click.FloatRange(min=0, min_open=True),
        help="Samples per second, where the file does not say.",
    ),
    click.option("--channels", help="Columns to use, by name or number: a,b."),
    click.option(
        "--skip-lines",
        type=click.IntRange(min=0),
        help="Lines before header or data.  [default: found out]",
    ),
    click.option("--columns", help="Names of all columns, where the file has none: a,b,c."),
    click.option(
        "--time-column",
        help="Column of time in seconds, by name or number.  [default: found out]",
    ),
)


def record_flags(verb: Callable[..., Any]) -> Callable[..., Any]:
    """Add the flags, and hand the verb a `Record` in place of them."""

    @functools.wraps(verb)
    def with_record(
        record_path: Path,
        rate_hz: float | None,
        channels: str | None,
        skip_lines: int | None,
        columns: str | None,
        time_column: str | None,
        **others: Any,
    ) -> Any:
        record = _read(
            record_path, rate_hz, _names(channels), skip_lines, _names(columns), time_column
        )
        for note in record.notes:
            click.echo(f"note: {note}", err=True)
        return verb(record=record, path=record_path, **others)

    for flag in reversed(FLAGS):
        with_record = flag(with_record)
    return click.argument(
        "record_path",
        metavar="RECORD",
        type=click.Path(exists=True, dir_okay=False, path_type=Path),
    )(with_record)


def _read(
    path: Path,
    rate_hz: float | None,
    channels: tuple[str, ...] | None,
    skip_lines: int | None,
    columns: tuple[str, ...] | None,
    time_column: str | None,
) -> Record:
    if path.suffix.lower() == ".mcap":
        return record_of(path, channels=channels)
    return read_record(
        path,
        rate_hz=rate_hz,
        channels=channels,
        skip_lines=skip_lines,
        columns=columns,
        time_column=time_column,
    )


def _names(text: str | None) -> tuple[str, ...] | None:
    return (
        None
        if text is None
        else tuple(name.strip() for name in text.split(",") if name.strip())
    )

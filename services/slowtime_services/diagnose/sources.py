"""Records that are named whole or in part."""

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path

from slowtime_services.files import (
    DateOrder,
    Record,
    RecordError,
    Repeated,
    in_si,
    part_of,
    read_record,
)
from slowtime_services.files.integrity import with_checked_values
from slowtime_services.replay import record_or_foreign

BINARY = (".npy", ".npz", ".mat")
SPAN = re.compile(r"(?P<path>.+)@(?P<first>[0-9.]*):(?P<last>[0-9.]*)")


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Source:
    """One record, and its name for people."""

    name: str
    record: Record


def split(text: str) -> tuple[Path, tuple[float, float] | None]:
    """Split the name of a file from the seconds of it that are meant.

    Examples
    --------
    >>> split("run.csv@10:22.5")
    (PosixPath('run.csv'), (10.0, 22.5))
    >>> split("run.csv@60:"), split("run.csv")
    ((PosixPath('run.csv'), (60.0, inf)), (PosixPath('run.csv'), None))
    """
    match = SPAN.fullmatch(text)
    if match is None or Path(text).exists():
        return Path(text), None
    try:
        span = float(match["first"] or 0), float(match["last"] or "inf")
    except ValueError:
        span = 1.0, 0.0
    if not span[0] < span[1]:
        raise RecordError(
            f"{text!r} asks for no part of {match['path']}. Write FILE@FROM:TO in seconds from "
            "its beginning, such as run.csv@10:22.5 or run.csv@60:."
        )
    return Path(match["path"]), span


def read_any(
    text: str | Path,
    rate_hz: float | None = None,
    *,
    skip_lines: int | None = None,
    time_column: str | None = None,
    time_unit: str | None = None,
    date_order: DateOrder | None = None,
    wrapped: bool | None = None,
    repeated: Repeated | None = None,
    units: Sequence[str] = (),
    sensitivities: Sequence[str] = (),
) -> Source:
    """Read a record of any kind, recordings included; values that are no numbers become NaN.

    Parameters
    ----------
    text
        Path of a file; ``path@FROM:TO`` for those seconds of it, counted from its beginning.
    rate_hz, skip_lines, time_column, time_unit, date_order, wrapped, repeated, units, \
    sensitivities
        As `slowtime_services.files.read_record` takes them; of a recording, rate and units
        only.
    """
    path, span = split(str(text))
    try:
        if path.suffix.lower() == ".mcap":
            record = record_or_foreign(path)
            if rate_hz is not None:
                record = dataclasses.replace(record, rate_hz=rate_hz)
            record = with_checked_values(record, path.name, repeated)
            record = in_si(record, units, sensitivities)
        else:
            record = read_record(
                path,
                rate_hz=rate_hz,
                skip_lines=skip_lines if path.suffix.lower() not in BINARY else None,
                time_column=time_column,
                time_unit=time_unit,
                date_order=date_order,
                wrapped=wrapped,
                repeated=repeated,
                units=units,
                sensitivities=sensitivities,
                # A model names its channels, so that a column of zeros may well be a force.
                keep=("all",),
                keep_missing=True,
            )
    except RecordError as error:
        said = str(error)
        raise RecordError(said if path.name in said else f"{path.name}: {said}") from None
    if span is None:
        return Source(path.name, record)
    return Source(Path(text).name, part_of(record, *span, name=path.name))

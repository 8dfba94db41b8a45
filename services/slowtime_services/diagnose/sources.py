"""Records that are named whole or in part."""

import dataclasses
import re
from pathlib import Path

from slowtime_services.declared import takes
from slowtime_services.files import (
    ReadingOptions,
    Record,
    RecordError,
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


@takes(ReadingOptions)
def read_any(text: str | Path, options: ReadingOptions) -> Source:
    """Read a record of any kind, recordings included; values that are no numbers become NaN.

    Parameters
    ----------
    text
        Path of a file; ``path@FROM:TO`` for those seconds of it, counted from its beginning. Of
        what is said of a recording, rate, units and repeated rows count.
    """
    path, span = split(str(text))
    try:
        if path.suffix.lower() == ".mcap":
            record = record_or_foreign(path)
            if options.rate_hz is not None:
                record = dataclasses.replace(record, rate_hz=options.rate_hz)
            record = with_checked_values(record, path.name, options.repeated)
            record = in_si(record, options.units, options.sensitivities)
        else:
            said = {one.name: getattr(options, one.name) for one in dataclasses.fields(options)}
            if path.suffix.lower() in BINARY:
                said["skip_lines"] = None
            # A model names its channels, so that a column of zeros may well be a force.
            said["keep"] = ("all",)
            record = read_record(path, **said, keep_missing=True)
    except RecordError as error:
        why = str(error)
        raise RecordError(why if path.name in why else f"{path.name}: {why}") from None
    if span is None:
        return Source(path.name, record)
    return Source(Path(text).name, part_of(record, *span, name=path.name))

"""What a person says of a file that is read, declared here alone.

The command line, the Python interface and `read_record` take names, types, defaults and help
from `ReadingOptions`. This module imports no arrays, so that `--help` costs nothing.
"""

import dataclasses
from collections.abc import Sequence
from typing import Literal, NamedTuple

ALL = "all"
MAX_BYTES = 1 << 30
"""Size up to which a file is read at once."""

TimeUnit = Literal["s", "ms", "us", "ns", "min", "h", "d"]
DateOrder = Literal["dmy", "mdy", "ymd"]
Repeated = Literal["drop", "keep"]
"""What is done with rows that repeat the one before."""

RARE = {"rare": True}
"""Metadata of a field that few need; the command line takes it as a key of `--reading`."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ReadingOptions:
    """What a person says of a file; it overrules what the file states.

    Parameters
    ----------
    rate_hz
        Sampling rate [Hz], where the file does not state it.
    channels
        Columns to use, by name or by number from 0; by default, all but clocks, counters,
        magnitudes, constants and words.
    skip_lines
        Lines of text before the header or the data; detected where not given.
    columns
        Names of all columns, for a file without a header.
    time_column
        Column of the time, by name or number; ``none`` if there is none; detected where not
        given.
    time_unit
        Unit of that column; by default, that of its name.
    date_order
        Order of day, month and year in dates such as 04/05/2024; detected where not given.
    wrapped
        Whether all columns are one series, several values a line; detected where not given.
    repeated
        Whether rows that repeat the row before in all channels are left out or are samples;
        detected where not given.
    keep
        Columns to keep although they are counters, magnitudes or the like; ``all`` for each.
    units
        Unit of all channels (g, mg, gal, in/s^2, mV ...), or several ``CHANNEL=UNIT``. Motion
        is converted to SI.
    sensitivities
        Scale of volts or counts: ``100mV/g``, ``x=10.2mV/(m/s^2)``, ``256LSB/g``.
    """

    rate_hz: float | None = None
    channels: Sequence[str] | None = None
    skip_lines: int | None = dataclasses.field(default=None, metadata=RARE)
    columns: Sequence[str] | None = dataclasses.field(default=None, metadata=RARE)
    time_column: str | None = dataclasses.field(default=None, metadata=RARE)
    time_unit: TimeUnit | None = dataclasses.field(default=None, metadata=RARE)
    date_order: DateOrder | None = dataclasses.field(default=None, metadata=RARE)
    wrapped: bool | None = dataclasses.field(default=None, metadata=RARE)
    repeated: Repeated | None = dataclasses.field(default=None, metadata=RARE)
    keep: Sequence[str] = dataclasses.field(default=(), metadata=RARE)
    units: Sequence[str] = dataclasses.field(
        default=(), metadata={"flag": "--unit", "metavar": "[CHANNEL=]UNIT"}
    )
    sensitivities: Sequence[str] = dataclasses.field(
        default=(),
        metadata={"flag": "--sensitivity", "metavar": "[CHANNEL=]SENSITIVITY", **RARE},
    )


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class RecordReading(ReadingOptions):
    """What a program adds to what a person says.

    Parameters
    ----------
    keep_missing
        Whether NaN and empty fields are kept, as NaN, instead of refused.
    skip_missing
        Whether rows in which a value is missing are left out as gaps, instead of refused.
    max_bytes
        What a file may hold at most.
    of_a_piece
        Whether it is a piece of a longer file, of which its heading states the number of points
        and the duration.
    """

    keep_missing: bool = False
    skip_missing: bool = False
    max_bytes: int = MAX_BYTES
    of_a_piece: bool = False


class MissingPolicy(NamedTuple):
    """Policy for missing values: keep them as NaN, or leave the rows out as gaps."""

    keep: bool
    skip: bool

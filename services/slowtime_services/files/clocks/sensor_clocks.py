"""Clocks of several sensors in one table, each in front of the channels that it is of."""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from slowtime_services.files.channels.auxiliary_columns import is_counter, is_slow
from slowtime_services.files.record import RecordError, find_column
from slowtime_services.files.sheet import Column, Sheet
from slowtime_services.files.times.time_axis import TimeAxis, looks_like_time, printed_digit
from slowtime_services.files.times.time_units import TIME_WORDS, words_of

from .candidates import RowClock, clock_of_numbers, clock_of_stamps

SAME_INSTANT_STEPS = 0.05
"""Difference of two times [steps] up to which they are one instant: at a quarter of the
sampling rate it turns a phase by 4.5 degrees. Source: judgement."""
LAST_DIGITS = 1.05
"""Difference of two times [units of the last digits] that rounding leaves."""
ZONE_STEP_S = 900.0
"""Step of the offsets of time zones [s]."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SensorClock:
    """A clock and the channels behind it, up to the next clock."""

    clock: RowClock
    axis: TimeAxis
    channels: tuple[int, ...]

    @property
    def place(self) -> int:
        """Place of its column."""
        return self.clock.columns[-1]


def clock_of_channels(sheet: Sheet, channels: Sequence[str] | None) -> int | None:
    """Return the column of the chosen channels' own clock; None where all clocks agree.

    Raises
    ------
    RecordError
        Where channels that are read together have clocks that tell different times.
    """
    found = sensor_clocks(sheet)
    if len(found) < 2:
        return None
    if channels is not None:
        chosen = {find_column(name, sheet.names) for name in channels}
        for one in found:
            if chosen <= set(one.channels):
                return one.place if any(_difference(one, other) for other in found) else None
    names = sheet.names
    for one, other in itertools.combinations(found, 2):
        if said := _difference(one, other):
            first, second = names[one.place], names[other.place]
            some = ",".join(names[place] for place in other.channels[:3])
            raise RecordError(
                f"Columns {first!r} and {second!r} are clocks of different sensors, and {said}"
                ": samples of a row were not taken at one instant. Read one sensor at a time, "
                f"as with --channels {some!r}, or write each into a file of its own; if only "
                "one clock is right, name it with --reading time_column."
            )
    return None


def sensor_clocks(sheet: Sheet) -> tuple[SensorClock, ...]:
    """Find the columns of times that have channels behind them."""
    names, columns = sheet.names, sheet.columns
    if sum(_may_be_clock(*pair) for pair in zip(columns, names, strict=True)) < 2:
        return ()
    clocks = {
        place: made
        for place, column in enumerate(columns)
        if (made := _clock(place, column, names[place], sheet.first_line)) is not None
    }
    found = []
    for place, (clock, axis) in clocks.items():
        end = min((other for other in clocks if other > place), default=len(columns))
        between = range(place + 1, end)
        kept = tuple(i for i in between if _may_be_channel(columns[i], names[i]))
        if kept:
            found.append(SensorClock(clock, axis, kept))
    return tuple(found)


def holds_time_word(name: str) -> bool:
    """Whether a word of a name is one of time, with or without a number behind.

    Examples
    --------
    >>> [holds_time_word(name) for name in ("t2", "Base_time", "Time 2 - slow", "acc")]
    [True, True, True, False]
    """
    return any(word.rstrip("0123456789") in TIME_WORDS for word in words_of(name))


def _may_be_clock(column: Column, name: str) -> bool:
    if column.stamps is not None:
        return column.kind != "date"
    return column.kind == "number" and holds_time_word(name)


def _clock(
    place: int, column: Column, name: str, first_line: int
) -> tuple[RowClock, TimeAxis] | None:
    """Read a column as a clock as far as it has values; None where it is none."""
    if not _may_be_clock(column, name):
        return None
    if column.stamps is not None:
        attempt: RowClock | RecordError = clock_of_stamps((place,), name, column.stamps)
    else:
        values = column.values
        if values.dtype.kind == "f":
            values = values[: _filled(values)]
        if len(values) < 3 or not looks_like_time(values.astype(float)):
            return None
        part = dataclasses.replace(column, values=values)
        attempt = clock_of_numbers(place, name, part)
    if isinstance(attempt, RecordError):
        return None
    try:
        return attempt, attempt.axis(first_line)
    except RecordError:
        return None


def _filled(values: Float[np.ndarray, " row"]) -> int:
    """Rows before the empty ones at the end."""
    present = np.flatnonzero(np.isfinite(values))
    return int(present[-1]) + 1 if present.size else 0


def _may_be_channel(column: Column, name: str) -> bool:
    if column.kind != "number" or column.values.dtype.kind not in "fiu":
        return False
    values = column.values.astype(float)
    present = values[np.isfinite(values)]
    if len(present) < 3 or (present == present[0]).all():
        return False
    return not is_counter(present, name) and not is_slow(
        dataclasses.replace(column, values=present), name
    )


def _difference(one: SensorClock, other: SensorClock) -> str:
    """Describe how two clocks differ; empty where they tell the same times."""
    first, second = one.clock, other.clock
    rows = min(len(first.values), len(second.values))
    times = [
        np.asarray(clock.values[:rows] - clock.values[0], dtype=float) * clock.scale
        for clock in (first, second)
    ]
    digits = sum(
        clock.scale * (clock.quantum or printed_digit(clock.values))
        for clock in (first, second)
    )
    allowed = max(LAST_DIGITS * digits, SAME_INSTANT_STEPS / one.axis.rate_hz)
    said = []
    if float(np.ptp(times[1] - times[0])) > allowed:
        said.append(f"run at {one.axis.rate_hz:.6g} Hz and {other.axis.rate_hz:.6g} Hz")
    apart = _offset(first, second)
    if apart is not None and abs(apart) > allowed:
        said.append(f"begin {abs(apart):.4g} s apart")
    return " and ".join(said)


def _offset(first: RowClock, second: RowClock) -> float | None:
    """Seconds from the first row of one clock to that of another; None if zeros may differ."""
    if first.origin_ns is not None and second.origin_ns is not None:
        apart = (second.origin_ns - first.origin_ns) * 1e-9
        zones = abs(apart) >= ZONE_STEP_S and abs(apart) % ZONE_STEP_S < 1e-6
        return None if zones else apart
    if first.origin_ns is not None or second.origin_ns is not None:
        return None
    if first.kind != second.kind:
        return None
    return float(second.values[0]) * second.scale - float(first.values[0]) * first.scale

"""Columns that may be the clock of a sheet: stamps, dates beside times, counters."""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Shaped

from slowtime_services.files.record import RecordError, find_column
from slowtime_services.files.sheet import Column, Sheet
from slowtime_services.files.times.other_axes import is_other_axis
from slowtime_services.files.times.stamps import DAY_NS, Stamps
from slowtime_services.files.times.time_axis import (
    TimeAxis,
    looks_like_time,
    read_time,
    signed,
    unwrapped,
)
from slowtime_services.files.times.time_units import (
    FIRST_EPOCH_S,
    LAST_EPOCH_S,
    is_time_name,
    scale_of,
    words_of,
)
from slowtime_services.files.times.zones import Zone, zone_in

from .fractions import fraction_beside, whole_seconds

HOUR_NS = DAY_NS // 24
DAY_S = 86400.0
_PARTS = (
    ("year", "yyyy", "yy", "jahr"), ("month", "mon", "mm", "mo", "monat"),
    ("day", "dd", "tag"), ("hour", "hh", "hr", "h", "stunde"),
    ("minute", "min", "mi", "mm", "mn"), ("second", "ss", "sec", "s", "sekunde", "seconds"),
)  # fmt: skip


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class RowClock:
    """A clock of the rows.

    Parameters
    ----------
    columns
        Places of the columns that it is read from.
    values
        Counts, one per row.
    scale
        Seconds per count.
    origin_ns
        Time of the first row since 1970-01-01 UTC; None where it is not told.
    quantum
        Step of the last digit, in counts; None to find out.
    said
        How it is read, as a person is told.
    sure
        Whether unit and form are stated by the file.
    named
        Whether the file calls it a time.
    kind
        Whether its values are dates and times, or counts.
    """

    columns: tuple[int, ...]
    name: str
    values: Shaped[np.ndarray, " time"]
    scale: float
    origin_ns: int | None
    quantum: float | None
    said: str
    sure: bool
    named: bool
    notes: tuple[str, ...] = ()
    kind: Literal["stamps", "numbers"] = "numbers"

    def axis(self, first_line: int) -> TimeAxis:
        """Rate, start and gaps by this clock."""
        return read_time(
            self.values,
            name=self.name,
            scale=self.scale,
            origin_ns=self.origin_ns,
            quantum=self.quantum,
            first_line=first_line,
        )


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ChosenClock:
    """Rate, start and gaps by the chosen clock, and which columns are clocks."""

    clock: RowClock | None
    axis: TimeAxis | None
    columns: frozenset[int]
    refusal: RecordError | None = None
    notes: tuple[str, ...] = ()


def read_clock(
    sheet: Sheet,
    names: tuple[str, ...],
    given: str | None,
    *,
    unit: str | None = None,
    stated_rate_hz: float | None = None,
) -> ChosenClock:
    """Read the clock of a sheet: the one named, else the first by name or form that works.

    Parameters
    ----------
    given
        Name or number of the time column; ``"none"`` for none; None to find out.
    unit
        Unit of the time column that a person states.
    stated_rate_hz
        The heading's rate, which can decide between units.
    """
    if given is not None and given.casefold() == "none":
        return ChosenClock(None, None, frozenset())
    only = None if given is None else find_column(given, names)
    read: list[tuple[RowClock, TimeAxis]] = []
    refusals: list[RecordError] = []
    times: set[int] = set()
    for attempt in _clocks(sheet, names, only, unit, stated_rate_hz):
        if isinstance(attempt, RecordError):
            refusals.append(attempt)
            continue
        if attempt.named:
            times.update(attempt.columns)
        try:
            read.append((attempt, attempt.axis(sheet.first_line)))
        except RecordError as error:
            refusals.append(error)
            if not attempt.named and only is None:
                refusals.pop()
    if not read:
        return ChosenClock(None, None, frozenset(times), refusals[0] if refusals else None)
    # Of several clocks, one with all its digits is better than one whose times repeat.
    read.sort(key=lambda pair: (not pair[0].named, bool(pair[1].notes), not pair[0].sure))
    clock, axis = read[0]
    _refuse_other_rates(read)
    if axis.start_ns is None:
        dated = [other.start_ns for _, other in read[1:] if other.start_ns is not None]
        axis = dataclasses.replace(axis, start_ns=dated[0] if dated else None)
    return ChosenClock(clock, axis, frozenset(times | set(clock.columns)), None, clock.notes)


def _refuse_other_rates(read: Sequence[tuple[RowClock, TimeAxis]]) -> None:
    clock, axis = read[0]
    for other, second in read[1:]:
        if not (other.named and clock.named) or second.notes:
            continue
        if abs(second.rate_hz / axis.rate_hz - 1) > 0.01:
            raise RecordError(
                f"Two columns contain different times: {clock.name!r} {axis.rate_hz:.6g} Hz, "
                f"{other.name!r} {second.rate_hz:.6g} Hz. Name the clock with "
                "--reading time_column, or its unit with --reading time_unit."
            )


def _clocks(
    sheet: Sheet,
    names: tuple[str, ...],
    only: int | None,
    unit: str | None,
    stated_rate_hz: float | None,
) -> Iterator[RowClock | RecordError]:
    """All that may be a clock, the likeliest first."""
    columns = sheet.columns
    yield from _stamped(columns, names, only, sheet.zone)
    yield from _six_column_clock(columns, names, only, sheet.zone)
    yield from _seconds_and_fractions(columns, names, only)
    for place, column in enumerate(columns):
        if column.kind != "number" or (only is not None and place != only):
            continue
        named = is_time_name(names[place])
        if only is None and not (named and _rises(column.values)):
            continue
        counted = _counted(
            place, names[place], column, named or only is not None, unit, stated_rate_hz
        )
        yield _in_zone(counted, _zone_of(column, sheet.zone))
    if only is not None or len(columns) == 1:
        return
    for place, column in enumerate(columns):
        if column.kind != "number" or is_time_name(names[place]) or not _rises(column.values):
            continue
        if is_other_axis(names[place], column.unit):
            continue
        if looks_like_time(column.values.astype(float)):
            yield _counted(place, names[place], column, False, unit, stated_rate_hz)


def clock_of_numbers(place: int, name: str, column: Column) -> RowClock | RecordError:
    """Make a clock of a column of numbers by its own name and unit."""
    return _counted(place, name, column, True, None, None)


def _rises(values: Shaped[np.ndarray, " time"]) -> bool:
    if values.dtype.kind not in "fiu" or not np.isfinite(values.astype(float)).all():
        return False
    steps = np.diff(values.astype(float))
    back, forth = np.count_nonzero(steps < 0), np.count_nonzero(steps > 0)
    return bool(forth and back <= 0.5 * forth and back < 0.1 * len(steps) + 2)


def _counted(
    place: int,
    name: str,
    column: Column,
    named: bool,
    unit: str | None,
    stated_rate_hz: float | None,
) -> RowClock | RecordError:
    """Read a clock of numbers."""
    values, notes = signed(column.values), ()
    if not np.isfinite(values.astype(float)).all():
        return RecordError(
            f"Column {name!r}, the clock, has values that are missing. Fill them in, or "
            "give --rate-hz if the rows are evenly spaced in time."
        )
    if len(values) < 2:
        return RecordError("One sample has no rate. Give a record of at least two rows.")
    split = _hours_minutes(values, name)
    if split is not None:
        said = f"{name!r} as hours, minutes and seconds"
        return RowClock((place,), name, split, 1.0, None, None, said, True, named)
    values, wrap = unwrapped(values)
    said_wrap: tuple[str, ...] = ()
    if wrap is not None:
        said_wrap = (
            f"The counter in column {name!r} restarts after {wrap:.0f}: counting continues.",
        )
    try:
        scale = scale_of(values, name, column.unit, given=unit, stated_rate_hz=stated_rate_hz)
    except RecordError as error:
        return error
    if not named and not scale.sure and scale.offset is None:
        scale = dataclasses.replace(scale, said=f"{name!r}, which grows steadily, in seconds")
    origin = _nanoseconds(values[0], scale.offset, scale.seconds)
    return RowClock(
        (place,), name, values, scale.seconds, origin, None, scale.said, scale.sure, named,
        (*notes, *said_wrap),
    )  # fmt: skip


def _nanoseconds(first: np.generic, offset: float | None, seconds: float) -> int | None:
    """Exact where the times are whole numbers: float64 resolves only 256 ns in this century."""
    if offset is None:
        return None
    unit = round(seconds * 1e9)
    if first.dtype.kind in "iu" and offset == int(offset):
        return (int(first) - int(offset)) * unit
    return round((float(first) - offset) * unit)


def _hours_minutes(
    values: Shaped[np.ndarray, " time"], name: str
) -> Shaped[np.ndarray, " time"] | None:
    """Seconds of times written ``hhmmss.fff`` as one number; None where they are not."""
    numbers = values.astype(float)
    if numbers[0] < 0 or numbers.max() >= 240_000 or numbers.max() < 60:
        return None
    seconds, minutes, hours = numbers % 100, numbers // 100 % 100, numbers // 10_000
    if seconds.max() >= 60 or minutes.max() >= 60:
        return None
    words = words_of(name)
    jumps = np.diff(numbers)
    # Each minute the number leaps over forty that no clock has.
    usual = float(np.median(jumps))
    leaps = np.count_nonzero((jumps > 40) & (jumps < 40 + 20 * max(usual, 0.05)) & (usual < 1))
    said = any(word in ("hhmmss", "hms") for word in words)
    if not said and not (leaps and leaps >= int(np.ptp(hours * 60 + minutes))):
        return None
    return np.asarray(hours * 3600 + minutes * 60 + seconds)


def _stamped(
    columns: Sequence[Column], names: tuple[str, ...], only: int | None, zone: Zone | None
) -> Iterator[RowClock | RecordError]:
    """Clocks of dates and times, a date beside its time joined."""
    dates = [i for i, column in enumerate(columns) if column.kind == "date"]
    if any(column.kind == "clock" for column in columns):
        dates += [i for i, column in enumerate(columns) if _is_midnights(column)]
    for place, column in enumerate(columns):
        if column.stamps is None or place in dates:
            continue
        if only is not None and place != only and only not in dates:
            continue
        stamps = column.stamps
        used: tuple[int, ...] = (place,)
        if not stamps.dated and dates:
            beside = min(dates, key=lambda date: abs(date - place))
            stamps, used = (
                _combine_date_and_time(columns[beside].stamps, stamps),
                (beside, place),
            )
        own = next((z for i in reversed(used) if (z := _zone_of(columns[i], None))), zone)
        clock = clock_of_stamps(used, names[place], stamps, own)
        yield _with_fraction(clock, columns, names, place)


def _is_midnights(column: Column) -> bool:
    """Whether stamps are dates that a spreadsheet wrote with a time of zero."""
    return column.kind == "stamp" and not (column.values % DAY_NS).any()


def _with_fraction(
    clock: RowClock, columns: Sequence[Column], names: tuple[str, ...], place: int
) -> RowClock:
    """Add the fractions of a second that stand in a column behind whole seconds."""
    part = fraction_beside(columns, names, place, clock.values, unnamed=True)
    if part is None:
        return clock
    start = None if clock.origin_ns is None else clock.origin_ns + int(part.ns[0])
    return dataclasses.replace(
        clock,
        columns=(*clock.columns, part.place),
        values=clock.values + part.ns,
        origin_ns=start,
        quantum=float(part.unit_ns),
        said=f"{clock.said}, with {names[part.place]!r} as fractions of a second",
    )


def _seconds_and_fractions(
    columns: Sequence[Column], names: tuple[str, ...], only: int | None
) -> Iterator[RowClock]:
    """Clocks of whole seconds as numbers, and of fractions behind them."""
    for place, column in enumerate(columns):
        if only is not None and place != only:
            continue
        seconds = whole_seconds(column, names[place])
        if seconds is None:
            continue
        part = fraction_beside(columns, names, place, seconds, unnamed=False)
        if part is None:
            continue
        values = seconds + part.ns
        dated = FIRST_EPOCH_S <= seconds[0] / 1e9 <= LAST_EPOCH_S
        said = f"{names[place]!r} as seconds{' since 1970' if dated else ''}"
        said += f", with {names[part.place]!r} as fractions of a second"
        used, start = (place, part.place), int(values[0]) if dated else None
        digit = float(part.unit_ns)
        yield RowClock(used, names[place], values, 1e-9, start, digit, said, True, True)


def _combine_date_and_time(date: Stamps | None, time: Stamps) -> Stamps:
    assert date is not None
    return Stamps(date.ns + time.ns, True, time.zoned, time.quantum_ns, date.ambiguous)


def _zone_of(column: Column, otherwise: Zone | None) -> Zone | None:
    """Return the time zone that a column states in its name or as its unit."""
    return zone_in(f"{column.name} [{column.unit}]") or otherwise


def _in_zone(clock: RowClock | RecordError, zone: Zone | None) -> RowClock | RecordError:
    """Return a clock of whole days, which count in the zone of the file; others are in UTC."""
    if isinstance(clock, RecordError) or clock.origin_ns is None or clock.scale != DAY_S:
        return clock
    if zone is None:
        return clock
    return dataclasses.replace(
        clock, origin_ns=clock.origin_ns - zone.ahead_ns, said=f"{clock.said}, {zone.said}"
    )


def clock_of_stamps(
    used: tuple[int, ...], name: str, stamps: Stamps, zone: Zone | None = None
) -> RowClock:
    """Make a clock of dates and times, or of times of day."""
    values, notes = stamps.ns, []
    if not stamps.dated:
        for period, what in ((DAY_NS, "midnight"), (HOUR_NS, "the hour")):
            values, wrap = unwrapped(values, float(period))
            if wrap is not None:
                notes.append(f"Times in column {name!r} run past {what}: counted on.")
                break
        notes.append(
            f"Column {name!r} contains times of day without a date, so the start time is "
            "not known."
        )
    origin = int(values[0]) if stamps.dated else None
    said = f"{name!r} as dates and times" if stamps.dated else f"{name!r} as times of day"
    if stamps.ambiguous:
        origin = None
        notes.append(
            f"Dates such as {stamps.ambiguous} may begin with the day, the month or the year, "
            "so the start time is not taken from them. State the order with --reading "
            "date_order=dmy, "
            "mdy or ymd."
        )
    elif stamps.dated and not stamps.zoned and zone is not None and origin is not None:
        origin -= zone.ahead_ns
        said += f" {zone.said}"
    elif stamps.dated and not stamps.zoned:
        said += " in UTC, because no time zone is stated"
    return RowClock(
        used,
        name,
        values,
        1e-9,
        origin,
        float(stamps.quantum_ns),
        said,
        True,
        True,
        tuple(notes),
        kind="stamps",
    )


def _six_column_clock(
    columns: Sequence[Column], names: tuple[str, ...], only: int | None, zone: Zone | None
) -> Iterator[RowClock | RecordError]:
    """Read a clock of six columns: year, month, day, hour, minute, second."""
    if only is not None or len(columns) < 7:
        return
    for first in range(len(columns) - 5):
        part = range(first, first + 6)
        words = [" ".join(words_of(names[i])) for i in part]
        known = all(w in allowed for w, allowed in zip(words, _PARTS, strict=True))
        if not known or any(columns[i].kind != "number" for i in part):
            continue
        year, month, day, hour, minute, second = (columns[i].values.astype(float) for i in part)
        try:
            days = np.array(
                [
                    f"{int(y):04d}-{int(m):02d}-{int(d):02d}"
                    for y, m, d in zip(year, month, day, strict=True)
                ],
                dtype="datetime64[D]",
            ).astype(np.int64)
        except (ValueError, OverflowError):
            return
        within = (hour * 60 + minute) * 60 * 1e9 + np.round(second * 1e9)
        ns = days * DAY_NS + within.astype(np.int64)
        said = f"{names[first]!r} to {names[first + 5]!r} as date and time "
        said += "in UTC" if zone is None else zone.said
        start = int(ns[0]) - (zone.ahead_ns if zone is not None else 0)
        clock = RowClock(tuple(part), names[first + 5], ns, 1e-9, start, None, said, True, True)
        yield _with_fraction(clock, columns, names, first + 5)
        return

"""The clock of a record, checked against the options that a user gives."""

import dataclasses
from collections.abc import Iterator

import numpy as np

from slowtime_services.files import plausibility
from slowtime_services.files.channels.auxiliary_columns import is_counter
from slowtime_services.files.headings.sampling import Facts
from slowtime_services.files.reading_options import ReadingOptions
from slowtime_services.files.record import RecordError
from slowtime_services.files.sheet import Sheet
from slowtime_services.files.times.other_axes import is_frequency_axis
from slowtime_services.files.times.time_axis import TimeAxis, UnevenError, looks_like_time
from slowtime_services.files.times.time_units import is_time_name

from . import candidates
from .sensor_clocks import clock_of_channels

BY_CLOCK = "time from column"
"""Begins the assumption of a record whose clock is one of its columns."""
FAR_S, FAR = 1.0, 0.01
"""Time of the first row, in seconds and in lengths of the record, beyond which a clock is not
counted from the start that a heading states."""


def clock_of_sheet(sheet: Sheet, said: ReadingOptions) -> candidates.ChosenClock:
    """Detect the clock; rows that are one series have none."""
    if said.wrapped:
        return candidates.ChosenClock(None, None, frozenset())
    told = _clock_of_columns(sheet, said)
    if said.rate_hz is None and (told.clock is None or not told.clock.named):
        _refuse_spectrum(sheet)
    return told


def _clock_of_columns(sheet: Sheet, said: ReadingOptions) -> candidates.ChosenClock:
    own = None
    if said.rate_hz is None and said.time_column is None:
        own = clock_of_channels(sheet, said.channels)
    stated = {value for fact in sheet.facts.of("rate") for value in fact.values}
    stated |= {1 / value for fact in sheet.facts.of("interval") for value in fact.values}
    return candidates.read_clock(
        sheet,
        sheet.names,
        said.time_column if own is None else sheet.names[own],
        unit=said.time_unit,
        stated_rate_hz=stated.pop() if len(stated) == 1 else None,
    )


def _refuse_spectrum(sheet: Sheet) -> None:
    """Refuse a table over frequencies or periods, which has no samples in time."""
    first = True
    for name, column in zip(sheet.names, sheet.columns, strict=True):
        if column.kind != "number" or column.values.dtype.kind not in "fiu":
            continue
        values = column.values.astype(float)
        if is_counter(values, name):
            continue
        rises = len(values) > 2 and bool((np.diff(values) > 0).all())
        if (
            is_frequency_axis(name, column.unit)
            and rises
            and (first or looks_like_time(values))
        ):
            raise RecordError(
                f"Column {name!r} is an axis of frequencies or periods: this is a spectrum, "
                "not a record in time. Export the time histories, or frequency responses with "
                "both parts (docs/modal_testing.md); if rows are samples after all, give "
                "--rate-hz."
            )
        first = False


def axis_of(
    told: candidates.ChosenClock, said: ReadingOptions, facts: Facts
) -> tuple[TimeAxis | None, tuple[str, ...]]:
    """Return the time axis by the clock; a given rate overrules it."""
    notes = told.notes
    if told.axis is None or told.clock is None:
        if told.refusal is None:
            return None, notes
        if said.rate_hz is None and (said.time_column is not None or told.columns):
            return None, (*notes, _heading_instead(facts, told.refusal))
        if said.rate_hz is not None:
            notes += (f"The clock was not used, since a rate was given: {told.refusal}",)
        return None, notes
    axis, name = told.axis, told.clock.name
    if said.rate_hz is not None:
        axis = dataclasses.replace(axis, stamped=None)
    if said.rate_hz is not None and axis.seconds is not None:
        axis = dataclasses.replace(axis, gaps=(), seconds=None, notes=())
        notes += (f"Rows were taken as evenly spaced; the rate of {name!r} wanders.",)
    if said.rate_hz is not None and abs(axis.rate_hz / said.rate_hz - 1) > 1e-3:
        notes += (
            f"Column {name!r} says {axis.rate_hz:g} Hz; {said.rate_hz:g} Hz was given and "
            "is used.",
        )
        return dataclasses.replace(axis, rate_hz=said.rate_hz, gaps=()), notes
    return axis, (*notes, *axis.notes)


def start_of(
    sheet: Sheet, axis: TimeAxis | None, told: candidates.ChosenClock
) -> tuple[int | None, tuple[str, ...]]:
    """Return the start by the clock, else by the heading, and the words that state it."""
    if axis is not None and axis.start_ns is not None:
        return axis.start_ns, ()
    if not sheet.start_said or sheet.start_ns is None:
        return sheet.start_ns, ()
    if told.clock is not None and axis is not None:
        late_s = abs(float(told.clock.values[0])) * told.clock.scale
        if late_s > FAR_S + FAR * len(told.clock.values) / axis.rate_hz:
            return None, ()  # counted from power-on or the like, of which the heading tells not
    return sheet.start_ns, (f"start by the heading ({sheet.start_said!r}), {sheet.start_zone}",)


def _heading_instead(facts: Facts, refusal: RecordError) -> str:
    """Note that the heading's rate is used, where uneven times have it on average.

    Raises
    ------
    RecordError
        The refusal, where the heading states no rate, or another.
    """
    stated = [value for fact in facts.of("rate") for value in fact.values]
    stated += [1 / value for fact in facts.of("interval") for value in fact.values]
    if isinstance(refusal, UnevenError) and stated and plausibility.is_near(
        refusal.mean_hz, stated[0]
    ):  # fmt: skip
        return f"The clock was not used, the heading states its mean rate: {refusal}"
    raise refusal


def no_clock(sheet: Sheet) -> str:
    """Describe why no column can be a clock."""
    names = sheet.names
    for name, column in zip(names, sheet.columns, strict=True):
        if is_time_name(name) and column.kind == "number":
            with np.errstate(invalid="ignore"):  # two infinities in a row
                back = int(np.sum(~(np.diff(column.values.astype(float)) > 0)))
            return (
                f"column {name!r} does not run forwards in {back} of {len(column.values) - 1} "
                "steps, and is no clock as it stands. Sort the rows by time if they are out of "
                "order"
            )
    return f"no time column was found among {', '.join(names)}"


def clock_words(
    told: candidates.ChosenClock, axis: TimeAxis | None, why: dict[str, str]
) -> Iterator[str]:
    """Describe the assumptions on the columns."""
    if told.clock is not None and axis is not None:
        yield f"{BY_CLOCK} {told.clock.said}"
    if why:
        apart = "; ".join(f"{name!r}: {reason}" for name, reason in why.items())
        yield f"set aside ({apart}), --reading keep=NAME keeps them"

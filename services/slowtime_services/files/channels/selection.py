"""Selection of the columns that are channels, with their units."""

from collections.abc import Sequence

import numpy as np

from slowtime_services.files.reading_options import ALL, ReadingOptions
from slowtime_services.files.record import NAMES_SLOW, RecordError, Values, find_column
from slowtime_services.files.sheet import Sheet
from slowtime_services.files.times.time_units import is_time_name

from . import auxiliary_columns

MAX_SENSORS_IN_TURN = 64
"""Sensors whose rows may alternate in a file [1]."""


def select_channels(
    file: str, sheet: Sheet, said: ReadingOptions, clocks: frozenset[int], *, sparse: bool
) -> tuple[tuple[int, ...], dict[str, str]]:
    """Columns to keep as channels, and why others are not."""
    names = sheet.names
    if said.channels is not None:
        return _chosen(said.channels, names, clocks, sheet), {}
    if said.wrapped:
        return tuple(range(len(names))), {}
    forced = set(range(len(names))) if tuple(said.keep) == (ALL,) else {
        find_column(name, names) for name in said.keep
    }  # fmt: skip
    apart = {
        place: reason
        for place, reason in auxiliary_columns.aside(
            sheet.columns,
            names,
            clocks,
            sparse=sparse,
            unnamed_clocks=(said.time_column or "").casefold() != "none",
        ).items()
        if place not in forced or sheet.columns[place].kind != "number"
    }
    kept = tuple(i for i in range(len(names)) if i not in clocks and i not in apart)
    if not kept:
        # A counter that is alone may be a sensor after all; words are none.
        kept = tuple(i for i in apart if sheet.columns[i].kind == "number")
        kept = tuple(i for i in kept if np.isfinite(sheet.columns[i].values).all())
        apart = {place: reason for place, reason in apart.items() if place not in kept}
    if not kept:
        raise RecordError(
            f"{file} has no channel beside its clock{_reasons(apart, names)}. Give a file with "
            "samples, or say which columns are some with --channels."
        )
    return kept, {names[place]: reason for place, reason in apart.items()}


def _reasons(apart: dict[int, str], names: tuple[str, ...]) -> str:
    said = "; ".join(f"{names[place]!r} is {reason}" for place, reason in apart.items())
    return f" ({said})" if said else ""


def _chosen(
    channels: Sequence[str], names: tuple[str, ...], clocks: frozenset[int], sheet: Sheet
) -> tuple[int, ...]:
    kept = tuple(find_column(name, names) for name in channels)
    for place in kept:
        if place in clocks:
            raise RecordError(
                f"{names[place]!r} is the clock of the record, not a channel. Leave it out; if "
                "it is one after all, give --time-column none and --rate-hz."
            )
        if sheet.columns[place].kind != "number":
            raise RecordError(
                f"{names[place]!r} holds {sheet.columns[place].kind}s, not numbers. Leave it "
                "out."
            )
    if len(set(kept)) != len(kept):
        raise RecordError(
            f"A channel was named twice in {', '.join(channels)}. Name each once."
        )
    return kept


def refuse_several_sensors(file: str, sheet: Sheet, used: frozenset[int]) -> None:
    """Ask about rows that are of one sensor after the other.

    Parameters
    ----------
    used
        Places of columns that the clock is read from.
    """
    clocks = [c for c in sheet.columns if c.stamps is not None or is_time_name(c.name)]
    if not any((np.diff(c.values) == 0).any() for c in clocks if c.kind != "word"):
        return
    for place, (name, column) in enumerate(zip(sheet.names, sheet.columns, strict=True)):
        period = _period(column.values) if column not in clocks and place not in used else 0
        if period > 1:
            found = ", ".join(map(str, column.values[:period]))
            raise RecordError(
                f"The rows of {file} list several sensors one after another at each time "
                f"(column {name!r} repeats {found[:80]}). Rearrange the file to one row "
                "for each time and one column for each sensor. If each row is a sample "
                "of its own and the rows are evenly spaced in time, give --rate-hz."
            )


def _period(values: Values) -> int:
    """Rows after which a column of few words or whole numbers repeats; 0 where it does not."""
    few = list(values[: 2 * MAX_SENSORS_IN_TURN])
    for period in range(2, min(MAX_SENSORS_IN_TURN, len(values) // 3) + 1):
        if few[period : 2 * period] == few[:period] and len(set(few[:period])) == period:
            return period if bool(np.all(values[period:] == values[:-period])) else 0
    return 0


def unit_of_channel(sheet: Sheet, place: int, kept: Sequence[int]) -> str:
    """Return the unit of a channel: its own, else the one that all samples have."""
    stated = sheet.columns[place].unit
    if stated or any(sheet.columns[i].unit for i in kept):
        return stated
    return "" if NAMES_SLOW.search(sheet.columns[place].name) else sheet.unit

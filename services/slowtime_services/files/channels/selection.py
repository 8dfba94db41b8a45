"""Selection of the columns that are channels, with their units."""

import re
from collections.abc import Sequence

import numpy as np

from slowtime_services.files.reading_options import ALL, ReadingOptions
from slowtime_services.files.record import (
    NAMES_ACCELERATION,
    NAMES_SLOW,
    RecordError,
    find_column,
)
from slowtime_services.files.sheet import Sheet

from . import auxiliary_columns

_UNIT_IN_NAME = re.compile(
    r"(?P<stem>.*[^\W_])_(?<!low_)(?<!high_)(?P<unit>g|mg|ug|m_?s\^?2|mps2|m/s\^?2|gal)", re.I
)


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
                "it is one after all, give --reading time_column=none and --rate-hz."
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


def unit_of_channel(sheet: Sheet, place: int, kept: Sequence[int]) -> str:
    """Return the unit of a channel: its own, else the one that all samples have."""
    stated = sheet.columns[place].unit or unit_in_name(sheet.columns[place].name)
    if stated or any(sheet.columns[i].unit for i in kept):
        return stated
    return "" if NAMES_SLOW.search(sheet.columns[place].name) else sheet.unit


def unit_in_name(name: str) -> str:
    """Find the unit that ends the name of an acceleration; empty where there is none.

    Examples
    --------
    >>> [unit_in_name(name) for name in ("ax_g", "AccY_mg", "acc_z_ms2", "low_g", "x_g")]
    ['g', 'mg', 'm/s^2', '', '']
    """
    match = _UNIT_IN_NAME.fullmatch(name)
    if match is None or not NAMES_ACCELERATION.search(match["stem"]):
        return ""
    unit = match["unit"].casefold()
    return "m/s^2" if unit[0] == "m" and "s" in unit else unit

"""Fractions of a second in a column of their own, beside whole seconds."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Int64

from slowtime_services.files.sheet import Column
from slowtime_services.files.times.time_units import is_time_name, stated_scale, words_of

SECOND_NS = 10**9
_UNITS = {
    10**6: "ms msec msecs milli millis millisec millisecond milliseconds millisekunde "
    "millisekunden",
    10**3: "us µs μs usec usecs micro micros microsec microsecond microseconds mikrosekunden",
    1: "ns nsec nsecs nano nanos nanosec nanosecond nanoseconds",
}
"""Words for parts of a second, by what they are worth [ns]."""
_UNIT_OF = {word: worth for worth, words in _UNITS.items() for word in words.split()}
_SECONDS = frozenset("s sec secs second seconds".split())
LEAST_REACH = 0.5
"""Share of a second that the largest fraction reaches where no name tells its unit [1]."""
LEAST_RESTARTS = 0.5
"""Share of the seconds at which a named fraction begins anew [1]; lost rows hide others."""


class Fraction(NamedTuple):
    """A column of fractions: its place, and nanoseconds since the whole second."""

    place: int
    ns: Int64[np.ndarray, " row"]
    unit_ns: int


def fraction_beside(
    columns: Sequence[Column],
    names: Sequence[str],
    place: int,
    seconds_ns: Int64[np.ndarray, " row"],
    *,
    unnamed: bool,
) -> Fraction | None:
    """Find the column that counts on within the seconds of another, and starts anew with each.

    Parameters
    ----------
    place
        Place of the column of seconds; a fraction stands behind it.
    seconds_ns
        Its whole seconds [ns].
    unnamed
        Whether the column next to it may be one without a name of it.
    """
    if (seconds_ns % SECOND_NS).any() or not (np.diff(seconds_ns) >= 0).all():
        return None
    for at in range(place + 1, len(columns)):
        words = words_of(names[at]) + words_of(columns[at].unit)
        worth = next((_UNIT_OF[word] for word in reversed(words) if word in _UNIT_OF), None)
        bare = unnamed and at == place + 1
        bare = bare and (not columns[at].name or is_time_name(columns[at].name))
        if (worth is None and not bare) or (values := _whole(columns[at])) is None:
            continue
        named = worth is not None
        worth = worth or _unit_by_size(values)
        if worth and values.max() * worth < SECOND_NS and _restarts(values, seconds_ns, named):
            return Fraction(at, values * worth, worth)
    return None


def whole_seconds(column: Column, name: str) -> Int64[np.ndarray, " row"] | None:
    """Return the whole seconds [ns] of a column of numbers that repeat; None if it has none."""
    words = words_of(name)
    seconds = bool(words) and words[-1] in _SECONDS
    if not seconds and not (is_time_name(name) and stated_scale(name, column.unit) is None):
        return None
    values = _whole(column)
    if values is None or values.max() >= 2**33 or not (np.diff(values) == 0).any():
        return None
    return values * SECOND_NS


def _whole(column: Column) -> Int64[np.ndarray, " row"] | None:
    """Return the values of a column of whole numbers from 0; None of any other."""
    if column.kind != "number" or column.values.dtype.kind not in "fiu":
        return None
    if not len(column.values):
        return None
    values = column.values.astype(float)
    if not np.isfinite(values).all() or (values < 0).any() or np.mod(values, 1).any():
        return None
    return column.values.astype(np.int64) if values.max() < 2**53 else None


def _unit_by_size(values: Int64[np.ndarray, " row"]) -> int:
    """Return nanoseconds per count, where the largest count is just below a second; else 0."""
    largest = int(values.max())
    fits = (w for w in _UNITS if LEAST_REACH * SECOND_NS <= largest * w < SECOND_NS)
    return next(fits, 0)


def _restarts(
    values: Int64[np.ndarray, " row"], seconds_ns: Int64[np.ndarray, " row"], named: bool
) -> bool:
    """Whether counts grow within each second, and fall where the second advances."""
    onwards, advances = np.diff(values), np.diff(seconds_ns) > 0
    if not (onwards[~advances] > 0).all():
        return False
    falls = onwards < 0
    if named:
        return bool(falls.sum() >= LEAST_RESTARTS * advances.sum() and (~advances).any())
    return bool(advances.any() and np.array_equal(falls, advances))

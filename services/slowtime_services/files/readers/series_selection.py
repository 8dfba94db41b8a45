"""Selection of the series of a file that were sampled together."""

import dataclasses
import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from slowtime_services.files.binary.numpy_arrays import as_double
from slowtime_services.files.headings.sampling import Fact, Facts
from slowtime_services.files.record import RecordError, find_column
from slowtime_services.files.sheet import Column, Sheet
from slowtime_services.files.times.stamps import Stamps

from .found import Found, Series

SLOWER = 10.0
"""Times by which a series is sampled more slowly, or is shorter, that is set aside unasked: a
temperature beside accelerations, say."""

MIN_VALUES = 2
"""Values that a series has at least [1]."""
RATE_TOLERANCE = 1e-3
"""Relative difference of rates [1] from which a file contradicts itself."""
Key = tuple[float | None, int, int | None]


def sheet_of(file: str, kind: str, found: Found, wanted: tuple[str, ...] | None) -> Sheet:
    """Choose the series that were sampled together.

    Raises
    ------
    RecordError
        Where there is none, or several groups might be meant: it names them.
    """
    found = dataclasses.replace(
        found, series=[one for one in found.series if len(one.values) >= MIN_VALUES]
    )
    if not found.series:
        raise RecordError(f"{file} is {kind} without any series of numbers. Give another file.")
    groups = [
        (key, list(group))
        for key, group in itertools.groupby(sorted(found.series, key=_order), key=_key)
    ]
    (rate, _, start_ns), chosen = _chosen(file, groups, found.series, wanted)
    chosen = [one for one in found.series if one in chosen]
    aside = [one for one in found.series if one not in chosen]
    notes = found.notes
    if aside:
        said = ", ".join(f"{one.name} ({_said(_key(one))})" for one in aside[:8])
        notes += (f"Sampled otherwise and left out: {said}{', ...' * (len(aside) > 8)}.",)
    facts = Facts() if rate is None else Facts(tuple(_facts(rate, found)))
    return Sheet(
        columns=tuple(_column(one) for one in chosen),
        named=True,
        facts=facts,
        format=kind if rate is not None else "",
        start_ns=start_ns,
        aux={name: np.asarray(value) for name, value in found.singles.items()},
        notes=notes,
    )


def _facts(rate: float, found: Found) -> Iterator[Fact]:
    """Return the rate of the series, and contradictions elsewhere in the file."""
    yield Fact("rate", (rate,), f"{rate:g} Hz", 0, 2)
    for figure in found.figures:
        if abs(figure.rate_hz / rate - 1.0) > RATE_TOLERANCE:
            yield Fact("rate", (figure.rate_hz,), f"{figure.text} {figure.rate_hz:g} Hz", 0, 2)


def _key(one: Series) -> Key:
    rate = None if one.rate_hz is None else float(f"{one.rate_hz:.9g}")
    return rate, len(one.values), one.start_ns


def _order(one: Series) -> tuple[float, int, int]:
    rate, count, start_ns = _key(one)
    return -(rate or 0.0), -count, start_ns or 0


def _chosen(
    file: str,
    groups: Sequence[tuple[Key, list[Series]]],
    series: Sequence[Series],
    wanted: tuple[str, ...] | None,
) -> tuple[Key, list[Series]]:
    if len(groups) == 1:
        return groups[0]
    if wanted is not None:
        names = tuple(one.name for one in series)
        asked = [series[find_column(name, names)] for name in wanted]
        for key, group in groups:
            if all(one in group for one in asked):
                return key, group
    else:
        first, *others = groups
        size = len(first[1][0].values)
        if all(SLOWER * len(group[0].values) <= size for _, group in others):
            return first
    said = "; ".join(
        f"{_said(key)}: {', '.join(one.name for one in group[:6])}{', ...' * (len(group) > 6)}"
        for key, group in groups[:8]
    )
    raise RecordError(
        f"{file} holds series that were not sampled together: {said}. Name channels of one of "
        "these with --channels."
    )


def _said(key: Key) -> str:
    rate, count, start_ns = key
    at = "" if rate is None else f" at {rate:g} Hz"
    since = "" if start_ns is None else f" from {np.datetime64(start_ns, 'ns')}"
    return f"{count:,} samples{at}{since}"


def _column(one: Series) -> Column:
    values = np.asarray(one.values)
    if one.stamps:
        values = values.astype(np.int64)
        steps = np.diff(values)
        steps = steps[steps > 0]
        quantum = int(np.gcd.reduce(steps[:1000])) if len(steps) else 1
        stamps = Stamps(values, True, True, max(quantum, 1))
        return Column(one.name, "", values, "stamp", stamps)
    return Column(one.name, one.unit, as_double(values))

r"""Rainflow cycles of a sequence of turning points, by vectorised passes.

Of the ranges :math:`r_i = |x_{i+1} - x_i|` between turning points, the range :math:`r_i` is a
closed cycle where :math:`r_{i-1} > r_i \le r_{i+1}`. Its two points are taken out, which joins
its neighbours, and the search goes on. The order in which cycles are taken out does not change
them, so that each pass takes out all that it finds. Ranges that are left over count as half a
cycle each. This is the count of ASTM E1049, whose three-point rule finds the same cycles one
after the other.

References
----------
.. [1] ASTM E1049-85 (2017), "Standard practices for cycle counting in fatigue analysis", 5.4.4.
.. [2] C. Amzallag et al., "Standardization of the rainflow counting method for fatigue
   analysis", Int. J. Fatigue 16 (1994) 287-293.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Series = Float[np.ndarray, " time"]
Points = Float[np.ndarray, " point"]

LEAST_SHARE = 0.02
"""Share of the points that a pass must take out to be worth more than a loop [1]; measured: a
pass costs about as much as the loop over a fiftieth of the points."""
FEW = 64
"""Points below which a loop is quicker than a pass."""


class Cycles(NamedTuple):
    """Cycles as counted.

    Parameters
    ----------
    ranges
        Maximum minus minimum, in the unit of the series.
    means
        Half the sum of maximum and minimum, in the same unit.
    counts
        1 for a closed cycle, 0.5 for half a cycle.
    """

    ranges: Float[np.ndarray, " cycle"]
    means: Float[np.ndarray, " cycle"]
    counts: Float[np.ndarray, " cycle"]

    def then(self, other: "Cycles") -> "Cycles":
        """Join two lists of cycles."""
        pairs = zip(self, other, strict=True)
        return Cycles(*(np.concatenate([mine, theirs]) for mine, theirs in pairs))


def cycles_of(low: Points, high: Points, count: float) -> Cycles:
    """List the cycles between pairs of points, in any order, each counted `count` times.

    Parameters
    ----------
    low, high
        Both turning points of each cycle [unit of stress].
    count
        Count of each cycle: 1, or 0.5 for a half cycle.

    Returns
    -------
    Ranges and means [unit of stress], and counts.
    """
    return Cycles(np.abs(high - low), (low + high) / 2, np.full(len(low), count))


def turning_points(series: Series) -> Float[np.ndarray, " point"]:
    """Select first and last sample and every peak and valley between them.

    Parameters
    ----------
    series
        Finite samples; of samples that repeat, one counts.

    Returns
    -------
    Turning points, in the unit of the series.

    Examples
    --------
    >>> turning_points(np.array([0.0, 1.0, 2.0, 2.0, -1.0, 0.5]))
    array([ 0. ,  2. , -1. ,  0.5])
    """
    if len(series) < 2:
        return np.asarray(series, dtype=float)
    # In a few passes over memory: this is what a long record takes its time for.
    up = series[1:] > series[:-1]
    turns = np.flatnonzero(up[1:] != up[:-1]) + 1
    some = np.concatenate([series[:1], series[turns], series[-1:]]).astype(float, copy=False)
    steps = np.diff(some)
    if np.all(steps[1:] * steps[:-1] < 0) and (len(steps) == 0 or steps.all()):
        return some
    some = some[np.concatenate([[True], steps != 0])]
    steps = np.diff(some)
    turn = np.flatnonzero(steps[1:] * steps[:-1] < 0) + 1
    ends = [some[:1], some[turn]] + ([some[-1:]] if len(some) > 1 else [])
    return np.asarray(np.concatenate(ends))


def extract(points: Points) -> tuple[Cycles, Float[np.ndarray, " left"]]:
    """Take out all closed cycles, and the half cycles that nothing later can close.

    Parameters
    ----------
    points
        Turning points; the last may be a sample on the way to one.

    Returns
    -------
    Cycles, and the residue: points whose ranges decrease strictly, to which later points may be
    appended.
    """
    lows: list[Points] = []
    highs: list[Points] = []
    while len(points) > FEW:
        ranges = np.abs(np.diff(points))
        inner = ranges[1:-1]
        closed = np.flatnonzero((ranges[:-2] > inner) & (inner <= ranges[2:])) + 1
        if not len(closed):
            break
        lows.append(points[closed])
        highs.append(points[closed + 1])
        kept = np.ones(len(points), dtype=bool)
        kept[closed] = kept[closed + 1] = False
        enough = 2 * len(closed) > LEAST_SHARE * len(points)
        points = points[kept]
        if not enough:
            break
    points, low, high = _loop(points)
    full = cycles_of(np.concatenate([*lows, low]), np.concatenate([*highs, high]), 1.0)
    # What is left rises to its largest range and falls after it: the rise stays open for ever.
    ranges = np.abs(np.diff(points))
    first = len(ranges) - 1 - int(np.argmax(ranges[::-1])) if len(ranges) else 0
    half = cycles_of(points[:first], points[1 : first + 1], 0.5)
    return full.then(half), points[first:]


def residue_cycles(residue: Points) -> Cycles:
    """Count half a cycle for each range that is left over.

    Parameters
    ----------
    residue
        Turning points whose ranges are not closed [unit of stress].
    """
    return cycles_of(residue[:-1], residue[1:], 0.5)


def rainflow(series: Series) -> Cycles:
    """Count the cycles of a whole record by ASTM E1049.

    Parameters
    ----------
    series
        Samples, such as stress [Pa].

    Returns
    -------
    Ranges and means, in the unit of the series, and counts.

    Raises
    ------
    ValueError
        Where samples are not finite.

    Examples
    --------
    The worked example of the standard: half cycles of 3, 4, 6, 8, 8, 9, a full one of 4.

    >>> cycles = rainflow(np.array([-2.0, 1, -3, 5, -1, 3, -4, 4, -2]))
    >>> sorted(zip(cycles.ranges.tolist(), cycles.counts.tolist()))
    [(3.0, 0.5), (4.0, 0.5), (4.0, 1.0), (6.0, 0.5), (8.0, 0.5), (8.0, 0.5), (9.0, 0.5)]
    """
    if not np.isfinite(series).all():
        raise ValueError(
            f"{int((~np.isfinite(series)).sum())} of {len(series)} samples are not finite. "
            "Leave them out or bridge them, or use a Counter, which skips and counts them."
        )
    cycles, residue = extract(turning_points(series))
    return cycles.then(residue_cycles(residue))


def _loop(
    points: Points,
) -> tuple[
    Float[np.ndarray, " left"], Float[np.ndarray, " cycle"], Float[np.ndarray, " cycle"]
]:
    """Take out the closed cycles one after the other."""
    stack: list[float] = []
    low: list[float] = []
    high: list[float] = []
    for point in points.tolist():
        stack.append(point)
        while len(stack) > 3:
            a, b, c, d = stack[-4:]
            between = abs(c - b)
            if not (abs(b - a) > between <= abs(d - c)):
                break
            low.append(b)
            high.append(c)
            stack[-3:] = (d,)
    return np.array(stack), np.array(low), np.array(high)

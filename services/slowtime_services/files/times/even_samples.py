"""Samples at even times out of rows whose rate wanders."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Num

from .time_axis import TimeAxis, even_times

DEGREE = 5
"""Degree of the interpolating spline [1]. Source: a sine of six samples a period is met to
1 %."""


def sampled_evenly(
    samples: Num[np.ndarray, "row channel"], axis: TimeAxis
) -> Float[np.ndarray, "sample channel"]:
    """Interpolate samples at even times by a spline, piece by piece between gaps.

    Between two rows at the end of a channel's range the value stays there: a saturated sensor
    tells no more, and a spline would swing beyond it.

    Parameters
    ----------
    samples
        Of the rows of a file, in any unit.
    axis
        Times of the rows, whose `seconds` are known; rate and gaps of the even times.

    Returns
    -------
    Samples at the even times that lie in no gap, in the same unit.
    """
    given = np.asarray(samples, dtype=float)
    pieces = list(_pieces(axis))
    return np.concatenate([
        np.column_stack([
            _interpolated(axis, rows, times, column) for column in given.T
        ]) for rows, times in pieces
    ])  # fmt: skip


def between_rows(
    values: Num[np.ndarray, " row"], axis: TimeAxis
) -> Float[np.ndarray, " sample"]:
    """Interpolate a column that is no channel linearly at the same times."""
    assert axis.seconds is not None
    times = np.concatenate([times for _, times in _pieces(axis)])
    return np.asarray(np.interp(times, axis.seconds, np.asarray(values, dtype=float)))


def _pieces(axis: TimeAxis) -> Iterator[tuple[slice, Float[np.ndarray, " sample"]]]:
    """Rows and even times between two gaps."""
    assert axis.seconds is not None
    even = even_times(axis.seconds, axis.rate_hz)
    row = sample = lost = 0
    for gap in axis.gaps:
        first = gap.row + lost  # counted with what is missing
        lost += gap.missing
        after = int(np.searchsorted(axis.seconds, even[first]))
        yield slice(row, after), even[sample:first]
        row, sample = after, first + gap.missing
    yield slice(row, len(axis.seconds)), even[sample:]


def _interpolated(
    axis: TimeAxis,
    rows: slice,
    times: Float[np.ndarray, " sample"],
    column: Float[np.ndarray, " row"],
) -> Float[np.ndarray, " sample"]:
    # Where it is needed: few edges have a file whose rate wanders.
    from scipy.interpolate import make_interp_spline

    assert axis.seconds is not None
    known, values = axis.seconds[rows], column[rows]
    degree = min(DEGREE, 2 * ((len(known) - 2) // 2) + 1)
    if degree < 1 or not np.isfinite(values).all():
        return np.asarray(np.interp(times, known, values))
    found = np.asarray(make_interp_spline(known, values, k=degree)(times))
    right = np.clip(np.searchsorted(known, times), 1, len(known) - 1)
    pair = values[right - 1], values[right]
    ends = np.nanmin(column), np.nanmax(column)
    held = (pair[0] == pair[1]) & np.isin(pair[0], ends)
    return np.asarray(np.where(held, pair[0], found))

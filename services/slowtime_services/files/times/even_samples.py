"""Samples at even times out of rows whose rate wanders, or whose stamps jitter."""

import numpy as np
from jaxtyping import Float, Num

from .time_axis import TimeAxis, even_times

DEGREE = 5
"""Degree of the interpolating spline [1]. Source: a sine of six samples a period is met to
1 %."""

BESIDE = 4
"""Rows on either side from which a row and its slope are predicted."""

LAGS = 64
"""Lags of the covariance from which weights are [1]."""

FLOOR = 0.1
"""Quantile of the spectral density that is taken for white noise [1], which has no slope."""

RIDGE = 1e-6
"""Least spectral density over its maximum [1], which keeps equations solvable."""

FEWEST_ROWS = 200
MOST_ROWS = 20_000
"""Rows from which is told whether samples jitter as their stamps do, at least and at most."""

SURE = 5.0
"""Least slope on the jitter over its standard deviation [1]: one in a million by chance."""

LEAST_SLOPE = 0.5
"""Least slope on the jitter [1]: 1 where rows were sampled at their stamps, 0 where they were
sampled evenly and stamped late. Noise in the slope of the signal makes it smaller."""


def chosen_axis(samples: Num[np.ndarray, "row channel"], axis: TimeAxis) -> TimeAxis:
    r"""Return the axis of rows that were sampled at their stamps, if the samples say so.

    A row that was sampled :math:`\delta` steps late differs from what its neighbours predict
    by :math:`\delta` times the slope, so that its error, regressed on that product, has the
    coefficient 1; of rows that were sampled evenly and stamped late, 0.

    Parameters
    ----------
    samples
        Of the rows of a file, in any unit.
    axis
        Times of the rows.

    Returns
    -------
    `axis.stamped`, or `axis` itself.
    """
    if axis.stamped is None or axis.stamped.seconds is None or len(samples) < FEWEST_ROWS:
        return axis
    steps = np.ones(len(samples))
    steps[[gap.row for gap in axis.gaps]] += [gap.missing for gap in axis.gaps]
    steps = steps[1:MOST_ROWS]
    late = axis.stamped.seconds[:MOST_ROWS] * axis.rate_hz
    late = late - np.concatenate([[0.0], np.cumsum(steps)])
    late -= late.mean()
    # Rows with a gap beside them have no neighbours to be predicted from.
    whole = np.convolve(steps == 1, np.ones(2 * BESIDE), "valid") > 2 * BESIDE - 0.5
    slope = weight = 0.0
    for column in np.asarray(samples[:MOST_ROWS], dtype=float).T:
        around = np.lib.stride_tricks.sliding_window_view(column, 2 * BESIDE + 1)
        usable = whole & np.isfinite(around).all(axis=1)
        if usable.sum() < FEWEST_ROWS or not np.ptp(around[usable]) > 0:
            continue
        value, moved = _predicted(around[usable] - around[usable].mean(), column)
        known = late[BESIDE:-BESIDE][usable] * moved
        left = value - known * (known @ value) / (known @ known)
        power = float(left @ left) / len(left)
        slope, weight = slope + known @ value / power, weight + known @ known / power
    sure = weight > 0 and slope > SURE * np.sqrt(weight) and slope > LEAST_SLOPE * weight
    return axis.stamped if sure else axis


def _predicted(
    around: Float[np.ndarray, "row near"], column: Float[np.ndarray, " time"]
) -> tuple[Float[np.ndarray, " row"], Float[np.ndarray, " row"]]:
    """Error of the best linear prediction of each row from those beside it, and its slope.

    Slopes are best linear predictions, too, so that a regression on them is not biased by
    their errors: from the derivative of the covariance, without the white noise in it.
    """
    series = np.where(np.isfinite(column), column - np.nanmean(column), 0.0)
    size = 2 * len(series)
    products = np.fft.irfft(np.abs(np.fft.rfft(series, size)) ** 2)[:LAGS] / len(series)
    # Bartlett's taper leaves a covariance a covariance.
    tapered = products * (1.0 - np.arange(LAGS) / LAGS)
    density = np.fft.rfft(np.concatenate([tapered, [0.0], tapered[:0:-1]])).real
    smooth = np.maximum(density - np.quantile(density, FLOOR), 0.0)
    turn = 2j * np.pi * np.fft.rfftfreq(2 * LAGS)
    slopes = np.fft.irfft(turn * smooth)
    near = np.delete(np.arange(-BESIDE, BESIDE + 1), BESIDE)
    covariance = np.fft.irfft(np.maximum(density, RIDGE * density.max()))
    within = covariance[np.abs(near[:, None] - near)]
    # Of the slope at 0 with the sample at k: minus the derivative of the covariance at k.
    weights = np.linalg.solve(within, np.stack([covariance[np.abs(near)], -slopes[near]], 1))
    told = np.delete(around, BESIDE, axis=1) @ weights
    return around[:, BESIDE] - told[:, 0], told[:, 1]


def sampled_evenly(
    samples: Num[np.ndarray, "row channel"], axis: TimeAxis
) -> Float[np.ndarray, "sample channel"]:
    """Interpolate samples at even times by a spline through all rows.

    A spline across a gap meets the samples beside it better than two that end there.

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
    times = _times(axis)
    given = np.asarray(samples, dtype=float)
    return np.column_stack([_interpolated(axis, times, column) for column in given.T])


def between_rows(
    values: Num[np.ndarray, " row"], axis: TimeAxis
) -> Float[np.ndarray, " sample"]:
    """Interpolate a column that is no channel linearly at the same times."""
    assert axis.seconds is not None
    return np.asarray(np.interp(_times(axis), axis.seconds, np.asarray(values, dtype=float)))


def _times(axis: TimeAxis) -> Float[np.ndarray, " sample"]:
    """Even times that lie in no gap."""
    assert axis.seconds is not None
    even = even_times(axis.seconds, axis.rate_hz)
    there = np.ones(len(even), dtype=bool)
    lost = 0
    for gap in axis.gaps:
        there[gap.row + lost : gap.row + lost + gap.missing] = False
        lost += gap.missing
    return even[there]


def _interpolated(
    axis: TimeAxis,
    times: Float[np.ndarray, " sample"],
    column: Float[np.ndarray, " row"],
) -> Float[np.ndarray, " sample"]:
    # Where it is needed: few edges have a file whose rate wanders.
    from scipy.interpolate import make_interp_spline

    assert axis.seconds is not None
    known = axis.seconds
    degree = min(DEGREE, 2 * ((len(known) - 2) // 2) + 1)
    if degree < 1 or not np.isfinite(column).all():
        return np.asarray(np.interp(times, known, column))
    found = np.asarray(make_interp_spline(known, column, k=degree)(times))
    right = np.clip(np.searchsorted(known, times), 1, len(known) - 1)
    pair = column[right - 1], column[right]
    ends = np.nanmin(column), np.nanmax(column)
    held = (pair[0] == pair[1]) & np.isin(pair[0], ends)
    return np.asarray(np.where(held, pair[0], found))

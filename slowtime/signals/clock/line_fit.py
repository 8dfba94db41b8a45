r"""Robust line fit of a sampling clock from delayed messages.

A message that holds samples up to sensor time :math:`x_k` (index over nominal rate) arrives at

.. math:: x_k + y_k, \qquad y_k = a + s \, x_k + L_k, \quad L_k \ge 0

with the latency :math:`L_k`. Each span of messages gives one point that is nearly free of it:
its lowest vertex (small where latencies crowd at their minimum) or its mean (small where they
are symmetric). A robust line through the points gives :math:`s`; the better of the two is the
one with the smaller standard deviation, which is measured from the scatter of the points and
therefore needs no distribution of the latency.

References
----------
.. [1] D. L. Mills, "Internet time synchronization: the network time protocol", IEEE Trans.
   Commun. 39 (1991) 1482-1493: minimum delay of a window of messages as its clock sample.
.. [2] P. J. Huber, E. M. Ronchetti, "Robust Statistics", 2nd ed. (2009), ch. 7.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from .lower_hull import Point, lowest

HUBER = 1.345
"""Residual, in standard deviations, beyond which a point loses weight: 95 % efficiency [2]."""
FITTED = 2
"""Numbers that make a line: so many residuals are small for no merit of theirs."""
FEWEST = 8
"""Points for a line whose scatter is to be known."""
ROUNDS = 12
"""Of a fit, at most; three or four are usual."""


@dataclasses.dataclass(frozen=True, slots=True)
class ClockSpan:
    """What is kept of consecutive messages.

    Parameters
    ----------
    number
        Which of the equal spans of sensor time it is.
    hull
        Lower convex hull of (sensor time, delay) [s].
    count, sum_x, sum_y
        Messages, and the sums of their sensor times and delays [s].
    """

    number: int
    hull: tuple[Point, ...]
    count: int
    sum_x: float
    sum_y: float

    def least_s(self, slope: float) -> float:
        """Least delay beyond a line through the origin [s].

        Parameters
        ----------
        slope
            Delay gained per sensor time, the slope of the line [1].
        """
        x, y = lowest(self.hull, slope)
        return y - slope * x

    def lateness_s(self, slope: float) -> float:
        """Mean delay beyond the least one [s].

        Parameters
        ----------
        slope
            Delay gained per sensor time [1].
        """
        return (self.sum_y - slope * self.sum_x) / self.count - self.least_s(slope)


@dataclasses.dataclass(frozen=True, slots=True)
class Line:
    """Delay over sensor time.

    Parameters
    ----------
    slope, slope_sd
        Delay gained per sensor time, and its standard deviation, widened so that 1.96 of them
        hold 95 % in spite of the few points behind it.
    x, level, level_sd
        Delay [s] at the mean sensor time x [s] of the points.
    scatter
        Robust standard deviation of the points about it [s].
    """

    slope: float
    slope_sd: float
    x: float
    level: float
    level_sd: float
    scatter: float

    def at(self, x: float) -> float:
        """Delay at a sensor time.

        Parameters
        ----------
        x
            Sensor time [s].

        Returns
        -------
        Delay [s].
        """
        return self.level + self.slope * (x - self.x)


@dataclasses.dataclass(frozen=True, slots=True)
class Points:
    """One point of each span, those late beyond any clock left out."""

    x: Float[np.ndarray, " span"]
    y: Float[np.ndarray, " span"]
    kept: tuple[int, ...]


def envelope(spans: Sequence[ClockSpan], slope: float, limit: float) -> Points:
    """Lowest vertex of each span along a line of the given slope.

    Parameters
    ----------
    spans
        Spans of messages.
    slope
        Slope of the line [1].
    limit
        Largest possible slope of the clock line [1].
    """
    points = np.array([lowest(span.hull, slope) for span in spans])
    return _within(points, limit)


def means(spans: Sequence[ClockSpan], limit: float) -> Points:
    """Mean sensor time and delay of each span, of those that are possible.

    Parameters
    ----------
    spans
        Spans of messages.
    limit
        Largest possible slope of the clock line [1].

    Returns
    -------
    Points.
    """
    points = np.array([(s.sum_x / s.count, s.sum_y / s.count) for s in spans])
    return _within(points, limit)


def _within(points: Float[np.ndarray, "span 2"], limit: float) -> Points:
    """Leave out what no clock within `limit` could give: a queue that is drained later."""
    x, y = points.T
    allowed = y[None, :] + limit * np.abs(x[:, None] - x[None, :])
    kept = np.flatnonzero(y <= allowed.min(axis=1) + 1e-12)
    return Points(x[kept], y[kept], tuple(kept.tolist()))


def fit(
    spans: Sequence[ClockSpan], limit: float, resolution_s: float, slope: float = 0.0
) -> Line | None:
    """Fit the line of a clock; None where the spans are too few to know its error.

    Parameters
    ----------
    spans
        Spans of messages.
    limit
        Largest relative error of the rate that is thought possible.
    resolution_s
        Of the stamps; the scatter is never taken to be less.
    slope
        A first guess.

    Returns
    -------
    The line; or None.
    """
    if len(spans) < FEWEST:
        return None
    low = _fit_envelope(spans, limit, resolution_s, slope)
    mean = fit_points(means(spans, limit), resolution_s)
    found = [line for line in (low, mean) if line is not None and abs(line.slope) < limit]
    return min(found, key=lambda line: line.slope_sd, default=None)


def _fit_envelope(
    spans: Sequence[ClockSpan], limit: float, resolution_s: float, slope: float
) -> Line | None:
    line = None
    for _ in range(ROUNDS):
        line = fit_points(envelope(spans, slope, limit), resolution_s)
        if line is None or abs(line.slope - slope) < 0.01 * line.slope_sd:
            break
        slope = min(max(line.slope, -limit), limit)
    return line


def fit_points(points: Points, resolution_s: float) -> Line | None:
    r"""Huber regression line, with standard deviations from the scatter of the points.

    With weights w, residuals r and scale :math:`\sigma`, the asymptotic variance of [2] is
    that of least squares with :math:`\sigma^2 E[\psi^2] / E[\psi']^2` for the variance.

    Parameters
    ----------
    points
        Points with weights.
    resolution_s
        Resolution of the time stamps [s].

    Returns
    -------
    Line, or None with too few points.
    """
    x, y = points.x, points.y
    if len(x) < FEWEST or np.ptp(x) <= 0:
        return None
    weights = np.ones_like(x)
    for _ in range(ROUNDS):
        middle, slope, level = _weighted(x, y, weights)
        residuals = y - level - slope * (x - middle)
        scale = max(spread_of(residuals), resolution_s)
        relative = np.abs(residuals) / scale
        before, weights = weights, np.minimum(1.0, HUBER / np.maximum(relative, 1e-300))
        if float(np.abs(weights - before).max()) < 1e-3:
            break
    psi = np.clip(residuals, -HUBER * scale, HUBER * scale)
    inner = float(np.count_nonzero(np.abs(residuals) <= HUBER * scale)) / len(x)
    free = len(x) - 2
    # Huber's correction for few points of the variance of a regression.
    few = 1.0 + 2.0 / len(x) * (1.0 - inner) / inner
    variance = max(float(psi @ psi) / free, resolution_s**2) * (few / inner) ** 2
    wide = widening(free)
    spread = float(np.sum((x - x.mean()) ** 2))
    return Line(
        slope=slope,
        slope_sd=wide * math.sqrt(variance / spread),
        x=middle,
        level=level,
        level_sd=wide * math.sqrt(variance / len(x)),
        scatter=scale,
    )


def spread_of(residuals: Float[np.ndarray, " span"]) -> float:
    """Estimate a standard deviation from the median of absolute residuals."""
    ranked = np.sort(np.abs(residuals))
    return 1.4826 * float(ranked[min((len(ranked) + FITTED) // 2, len(ranked) - 1)])


def _weighted(
    x: Float[np.ndarray, " span"],
    y: Float[np.ndarray, " span"],
    weights: Float[np.ndarray, " span"],
) -> tuple[float, float, float]:
    """Weighted least squares: mean of x, slope, level there."""
    total = weights.sum()
    middle = float(weights @ x / total)
    level = float(weights @ y / total)
    along = weights * (x - middle)
    return middle, float(along @ (y - level) / (along @ (x - middle))), level


def widening(free: int) -> float:
    """97.5 % point of Student's t over that of the normal distribution (Cornish-Fisher)."""
    z = 1.959964
    return (
        1.0
        + (z**2 + 1) / (4 * free)
        + (5 * z**4 + 16 * z**2 + 3) / (96 * free**2)
        + (3 * z**6 + 19 * z**4 + 17 * z**2 - 15) / (384 * free**3)
    )

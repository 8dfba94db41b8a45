r"""Posterior distribution of the damping ratio of a fitted resonance.

With few half-bandwidths of record the likelihood of the damping is skewed, and curvature at its
top says little about its tails. Here it is followed along a raster of damping ratios, the other
parameters at their likeliest and marginalised about it (Laplace),

.. math:: p(\zeta) \propto \zeta^{-1/2} \, \hat L(\zeta) \, |\Sigma(\zeta)|^{1/2} ,

on :math:`0 < \zeta < 0.8`. The prior is Jeffreys': the information on :math:`\ln \zeta`
grows as :math:`\zeta` (`ambient_law`). Intervals under it hold to second order [1]_; under a
flat prior the damping of short records is too high.

References
----------
.. [1] B. L. Welch, H. W. Peers, "On formulae for confidence points based on integrals of
   weighted likelihoods", J. R. Stat. Soc. B 25 (1963).
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr, ndtri

from .spline import cubic_spline
from .whittle import DAMPING, FLOOR, FREQUENCY, PEAK, PosteriorMaximum

STRIDE, WIDENING, MOST_POINTS = 0.6, 1.15, 30
"""Grid of ln zeta: first step [standard deviations], growth of the step per point, and largest
number of points on either side."""

DROP = 12.0
"""Fall of the log-likelihood at which the grid ends."""

LEAST_DAMPING, MOST_DAMPING = 1e-5, 0.8
"""Range of the prior of the damping ratio [1]."""

JEFFREYS = 0.5
"""Exponent of the prior of ln zeta, the square root of the information on it, in zeta [1]."""

FEWEST_POINTS = 4
"""Grid points below which the Gaussian approximation is used."""

FINE = 801
"""Points of the interpolated posterior."""

LEVEL = 0.95
"""Probability of the interval that sets the standard deviation."""

FAR = 4.2
"""Second interval that sets the standard deviation, as a Gaussian quantile: it keeps the tails
of the posterior covered as well as its 95 % interval."""


@dataclasses.dataclass(frozen=True, slots=True)
class DampingPosterior:
    """Median of the damping ratio, its honest deviation, and the frequency's beyond it.

    Of `sd`, 1.96 either side of the median hold 95 %; the variance is that of ln f, over all
    dampings.
    """

    value: float
    sd: float
    log_frequency_variance: float


def damping_posterior(
    profile: Callable[[Float[np.ndarray, " parameter"]], PosteriorMaximum],
    top: PosteriorMaximum,
) -> DampingPosterior:
    """Posterior of the damping ratio of a resonance.

    `profile` gives the top of the posterior at the damping of the parameters it is given,
    starting from the others of them. The raster begins at `top`, that over all parameters.
    """
    points = _points(profile, top)
    if len(points) < FEWEST_POINTS:
        return _gaussian(top)
    points.sort(key=lambda peak: float(peak.parameters[DAMPING]))
    places = np.array([peak.parameters[DAMPING] for peak in points])
    level = np.array([peak.log_posterior + _volume(peak) for peak in points])
    frequency = np.array([peak.parameters[FREQUENCY] for peak in points])
    variance = np.array([peak.covariance[FREQUENCY, FREQUENCY] for peak in points])
    fine = np.linspace(places[0], places[-1], FINE)
    log_density = cubic_spline(places, level, fine) + JEFFREYS * fine
    weight = np.exp(log_density - log_density.max())
    cumulated = np.concatenate([[0.0], np.cumsum(0.5 * (weight[1:] + weight[:-1]))])
    cumulated /= cumulated[-1]
    damping = np.exp(fine)
    value = float(np.interp(0.5, cumulated, damping))
    sd = max(
        _deviation(value, damping, cumulated, LEVEL),
        _deviation(value, damping, cumulated, 2 * float(ndtr(FAR)) - 1),
    )
    weight = weight / weight.sum()
    place = np.interp(fine, places, frequency)
    spread = np.interp(fine, places, variance)
    middle = float(weight @ place)
    return DampingPosterior(value, sd, float(weight @ (spread + (place - middle) ** 2)))


def _gaussian(top: PosteriorMaximum) -> DampingPosterior:
    """Take the curvature at the top, where the top lies at an end of the prior."""
    damping = float(np.exp(top.parameters[DAMPING]))
    sd = np.sqrt(np.diag(top.covariance))
    return DampingPosterior(damping, float(damping * sd[DAMPING]), float(sd[FREQUENCY] ** 2))


def _points(
    profile: Callable[[Float[np.ndarray, " parameter"]], PosteriorMaximum],
    top: PosteriorMaximum,
) -> list[PosteriorMaximum]:
    """Tops along a raster of ln zeta."""
    middle = float(top.parameters[DAMPING])
    points = [profile(top.parameters)]
    best = points[0].log_posterior
    step = STRIDE * min(float(np.sqrt(top.covariance[DAMPING, DAMPING])), 1.0)
    for sign in (-1.0, 1.0):
        theta, place, stride = points[0].parameters, middle, step
        # The skirts say how strong the force is, whatever the damping.
        ahead = np.zeros(len(theta))
        ahead[PEAK] = -2 * sign
        for _ in range(MOST_POINTS):
            place += sign * stride
            if not np.log(LEAST_DAMPING) <= place <= np.log(MOST_DAMPING):
                break
            start = theta + stride * ahead
            start[DAMPING] = place
            points.append(profile(start))
            ahead = (points[-1].parameters - theta) / stride
            # About the floor that a search begins with lies its prior.
            ahead[FLOOR] = 0.0
            theta = points[-1].parameters
            best = max(best, points[-1].log_posterior)
            if points[-1].log_posterior < best - DROP:
                break
            stride *= WIDENING
    return points


def _volume(peak: PosteriorMaximum) -> float:
    """Logarithm of the width of the posterior in the other parameters."""
    others = np.delete(np.delete(peak.covariance, DAMPING, 0), DAMPING, 1)
    free = np.diag(others) > 0
    return 0.5 * float(np.linalg.slogdet(others[np.ix_(free, free)])[1])


def _deviation(value: float, damping: np.ndarray, cumulated: np.ndarray, level: float) -> float:
    """Deviation of which so many either side of a value hold `level`."""
    away = np.linspace(0.0, damping[-1], 4001)
    held = np.interp(value + away, damping, cumulated) - np.interp(
        value - away, damping, cumulated, left=0.0
    )
    reach = float(away[min(int(np.searchsorted(held, level)), len(away) - 1)])
    return reach / float(ndtri(0.5 + level / 2))

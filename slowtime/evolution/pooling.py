r"""Partial pooling of drift rates over similar assets.

The rate :math:`\hat r_i` that was read off member i has a standard deviation :math:`s_i`, and
the rates themselves differ from asset to asset,

.. math:: \hat r_i \sim N(r_i, s_i^2), \qquad r_i \sim N(\mu, \tau^2) .

With a flat prior on the fleet mean :math:`\mu` and a half-Cauchy prior on the spread
:math:`\tau`, all is closed given :math:`\tau`; over :math:`\tau` is summed.

References
----------
.. [1] A. Gelman et al., "Bayesian Data Analysis", 3rd ed., CRC Press (2013), section 5.4.
.. [2] A. Gelman, "Prior distributions for variance parameters in hierarchical models",
   Bayesian Analysis 1 (2006) 515-534.
"""

import dataclasses
import math

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

LEVEL = 0.95
"""Probability of the intervals."""

FEWEST_READINGS = 4
"""Least number of readings of one asset: two for the line, two for its scatter."""

_SPREADS = 200
"""Grid points of the spread between assets, of equal prior probability."""

_NEGLIGIBLE = 1e-7
"""Posterior weight of a grid point, relative to the largest, below which it is left out."""

_HALVINGS = 36
"""Bisections in the search of a quantile."""


@dataclasses.dataclass(frozen=True, slots=True)
class DriftRate:
    """A drift rate with its uncertainty.

    Parameters
    ----------
    value
        Mean [unit of the quantity per slow time].
    sd
        Standard deviation; infinite where too few assets are known for it to exist.
    lo, hi
        Ends of the 95 % interval.
    """

    value: float
    sd: float
    lo: float
    hi: float


@dataclasses.dataclass(frozen=True, slots=True)
class Pool:
    """Drift rates of like assets.

    Parameters
    ----------
    fleet
        Mean rate of all such assets.
    spread
        Standard deviation of the rates between assets: its mean, sd and interval.
    another
        Rate of an asset of which nothing is known yet.
    members
        Rate of each member, given its own readings and those of all others.
    shrinkage
        Of each member, by which share its rate is drawn towards the fleet mean: 0 where its
        own readings say all, 1 where they say nothing.
    """

    fleet: DriftRate
    spread: DriftRate
    another: DriftRate
    members: tuple[DriftRate, ...]
    shrinkage: Float[np.ndarray, " member"]


def drift_rate(
    slow_time: Float[np.ndarray, " time"],
    value: Float[np.ndarray, " time"],
    sd: Float[np.ndarray, " time"],
) -> tuple[float, float] | None:
    r"""Fit a straight line to a history; its slope and the slope's standard deviation.

    Weighted least squares. The standard deviation is widened where the readings scatter more
    about the line than theirs say, and by :math:`\sqrt{(1 + \phi) / (1 - \phi)}` where
    neighbouring residuals are correlated by :math:`\phi > 0`.

    Parameters
    ----------
    slow_time, value, sd
        Readings in order, of one unit of slow time.

    Returns
    -------
    Slope and its standard deviation; None of fewer than `FEWEST_READINGS` at different times.
    """
    if len(np.unique(slow_time)) < FEWEST_READINGS:
        return None
    weight = 1.0 / np.maximum(sd, 1e-300) ** 2
    weight = weight / weight.max()
    scale = float(np.max(sd))
    centre = float(np.sum(weight * slow_time) / np.sum(weight))
    time = slow_time - centre
    square = float(np.sum(weight * time**2))
    level = float(np.sum(weight * value) / np.sum(weight))
    slope = float(np.sum(weight * time * value)) / square
    residual = np.sqrt(weight) * (value - level - slope * time)
    chi2 = float(np.sum(residual**2)) / (scale**2 * (len(value) - 2)) if scale > 0 else math.inf
    phi = float(np.sum(residual[1:] * residual[:-1]) / max(np.sum(residual**2), 1e-300))
    # Residuals about a fitted line are anticorrelated a little by the fit itself.
    phi = min(max(phi + 1.0 / len(value), 0.0), 0.98)
    widened = max(chi2, 1.0) if scale > 0 else 1.0
    base = scale if scale > 0 else float(np.sqrt(np.mean(residual**2)))
    return slope, base * math.sqrt(widened / square * (1.0 + phi) / (1.0 - phi))


def pool(
    rates: Float[np.ndarray, " member"],
    sds: Float[np.ndarray, " member"],
    *,
    spread_scale: float | None = None,
) -> Pool:
    r"""Pool the drift rates of like assets.

    Parameters
    ----------
    rates, sds
        Of each member, its rate and the standard deviation of that; a rate of NaN stands for a
        member without readings. At least one has some.
    spread_scale
        Scale of the half-Cauchy prior on the spread, in the unit of the rates: with probability
        1/2 the spread is smaller. By default the root mean square of the rates, since rates of
        like assets rarely differ by more than what they are.

    Returns
    -------
    Pooled rates, and their spread among the assets.

    Raises
    ------
    ValueError
        Where no member has a rate, or a standard deviation is not positive.

    Examples
    --------
    >>> found = pool(np.array([-0.9, -1.1, -1.0, np.nan]), np.array([0.1, 0.1, 0.1, np.nan]))
    >>> round(found.fleet.value, 3), round(found.members[3].value, 3)
    (-1.0, -1.0)
    """
    known = np.isfinite(rates)
    if not known.any():
        raise ValueError("No member has a drift rate. Wait for readings of at least one.")
    r, s = rates[known], sds[known]
    if not np.all((s > 0) & np.isfinite(s)):
        raise ValueError(
            f"Standard deviations {s!r:.80} were given. Give positive numbers, one a rate."
        )
    scale = spread_scale if spread_scale is not None else float(np.sqrt(np.mean(r**2)))
    tau, weight = _spreads(r, s, max(scale, 1e-300))
    variance = s**2 + tau[:, None] ** 2
    mu_variance = 1.0 / np.sum(1.0 / variance, axis=1)
    mu = mu_variance * np.sum(r / variance, axis=1)
    many = len(r) > 2
    share = s**2 / variance
    means = (1.0 - share) * r + share * mu[:, None]
    sds_given = np.sqrt((1.0 - share) * s**2 + share**2 * mu_variance[:, None])
    ahead = np.stack([np.sqrt(mu_variance), np.sqrt(mu_variance + tau**2)], axis=1)
    fleet, another = _mixtures(weight, np.stack([mu, mu], axis=1), ahead, many)
    own = iter(_mixtures(weight, means, sds_given, many=True))
    shrinkage = np.ones(len(rates))
    shrinkage[known] = weight @ share
    return Pool(
        fleet,
        _rate_from_posterior(weight, tau, many),
        another,
        tuple(next(own) if there else another for there in known),
        shrinkage,
    )


def _spreads(
    r: Float[np.ndarray, " member"], s: Float[np.ndarray, " member"], scale: float
) -> tuple[Float[np.ndarray, " spread"], Float[np.ndarray, " spread"]]:
    """Values of the spread, equally probable beforehand, and their posterior weights."""
    u = (np.arange(_SPREADS) + 0.5) / _SPREADS
    tau = scale * np.tan(0.5 * np.pi * u)
    variance = s**2 + tau[:, None] ** 2
    precision = np.sum(1.0 / variance, axis=1)
    mu = np.sum(r / variance, axis=1) / precision
    log_likelihood = -0.5 * (
        np.log(precision)
        + np.sum(np.log(variance), axis=1)
        + np.sum((r - mu[:, None]) ** 2 / variance, axis=1)
    )
    weight = np.exp(log_likelihood - log_likelihood.max())
    kept = weight > _NEGLIGIBLE
    return tau[kept], weight[kept] / weight[kept].sum()


def _mixtures(
    weight: Float[np.ndarray, " spread"],
    mean: Float[np.ndarray, "spread mixture"],
    sd: Float[np.ndarray, "spread mixture"],
    many: bool,
) -> list[DriftRate]:
    """Mean, standard deviation and interval of each of some mixtures of normals."""
    value = weight @ mean
    deviation = np.sqrt(weight @ (sd**2 + (mean - value) ** 2)) if many else math.inf + value
    lo, hi = (
        _quantiles(weight, mean, sd, share) for share in (0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0)
    )
    return [DriftRate(*one) for one in np.stack([value, deviation, lo, hi], axis=1).tolist()]


def _quantiles(
    weight: Float[np.ndarray, " spread"],
    mean: Float[np.ndarray, "spread mixture"],
    sd: Float[np.ndarray, "spread mixture"],
    share: float,
) -> Float[np.ndarray, " mixture"]:
    """Bisect the distribution function of each mixture."""
    lo, hi = np.min(mean - 9.0 * sd, axis=0), np.max(mean + 9.0 * sd, axis=0)
    for _ in range(_HALVINGS):
        middle = 0.5 * (lo + hi)
        below = weight @ ndtr((middle - mean) / sd) < share
        lo, hi = np.where(below, middle, lo), np.where(below, hi, middle)
    return np.asarray(0.5 * (lo + hi))


def _rate_from_posterior(
    weight: Float[np.ndarray, " spread"], tau: Float[np.ndarray, " spread"], many: bool
) -> DriftRate:
    value = float(weight @ tau)
    below = np.cumsum(weight) - 0.5 * weight
    lo, hi = np.interp([0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0], below, tau).tolist()
    if not many:
        return DriftRate(math.inf, math.inf, lo, hi)
    return DriftRate(value, math.sqrt(float(weight @ (tau - value) ** 2)), lo, hi)

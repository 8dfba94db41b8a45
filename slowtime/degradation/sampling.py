"""Adaptive importance sampling of a few parameters, from fixed points."""

import dataclasses
from collections.abc import Callable

import numpy as np
import scipy
from jaxtyping import Float
from scipy.special import chdtri, gammaln, logsumexp, ndtri

from slowtime.estimation.hyperparameters import HyperparameterPrior, climb

FREEDOM = 5.0
"""Degrees of freedom of the t proposals [1]: tails heavier than the posterior's."""

WIDER = 1.2
"""Width of the proposal about a maximum over that of its curvature [1]."""

NARROW = 2e-3
"""Step of the differences about a maximum, over the width of the prior [1]: the period of a
wave may be known to a thousandth of it."""

TEMPERED = 24
"""Points that must count before a proposal is fitted [1]; the posterior is tempered to it."""


@dataclasses.dataclass(frozen=True, slots=True)
class WeightedPoints:
    """Points with importance weights.

    Parameters
    ----------
    points
        Parameters [point, parameter].
    log_base
        Logarithm of prior density over proposal density and number of points: with the
        logarithm of the likelihood added, the sum of exponentials is the evidence.
    """

    points: Float[np.ndarray, "point parameter"]
    log_base: Float[np.ndarray, " point"]


def importance_sample(
    log_likelihood: Callable[[np.ndarray], np.ndarray],
    log_prior: Callable[[np.ndarray], np.ndarray],
    first: Callable[[np.ndarray], np.ndarray],
    log_first: Callable[[np.ndarray], np.ndarray],
    dimensions: int,
    *,
    points: int = 256,
    rounds: int = 3,
    starts: Float[np.ndarray, "start parameter"] | None = None,
) -> WeightedPoints:
    """Sample from a first proposal, then from t laws fitted to the weighted points so far.

    The second proposal is a t law about the maximum that Newton's method reaches from the
    likeliest point so far, or from the likeliest start: a narrow mode is found that way.

    All points count together, each with the density of the whole mixture of proposals
    (deterministic-mixture weights): the same readings give the same points, to the last bit.

    Parameters
    ----------
    log_likelihood, log_prior
        Points [point, parameter] to logarithms of densities.
    first, log_first
        Standard normal points to points of the first proposal, and its log density.
    starts
        Points near which the posterior may be greatest, where they are known.

    References
    ----------
    .. [1] J.-M. Cornuet et al., "Adaptive multiple importance sampling" (2012).
    """
    likely = _defined(log_likelihood)
    normal, radial = _even(points, dimensions)
    every = [first(normal)]
    densities: list[Callable[[np.ndarray], np.ndarray]] = [log_first]
    likelihood = [likely(every[0])]
    for number in range(rounds):
        if number == 0:
            begin = every[0] if starts is None else starts
            mean, factor = _climbed(likely, log_prior, begin)
        else:
            together = np.concatenate(every)
            log = np.concatenate(likelihood) + log_prior(together)
            mean, factor = _fitted(together, log - _mixed(densities, together))
        every.append(mean + (normal * radial[:, None]) @ factor.T)
        densities.append(_t_density(mean, factor))
        likelihood.append(likely(every[-1]))
    together = np.concatenate(every)
    base = log_prior(together) - _mixed(densities, together) - np.log(len(together))
    total = base + np.concatenate(likelihood)
    kept = total > total.max() - 14.0
    return WeightedPoints(together[kept], base[kept])


def _defined(
    log_likelihood: Callable[[np.ndarray], np.ndarray],
) -> Callable[[np.ndarray], np.ndarray]:
    """Give no likelihood to points so far out in a proposal's tails that a law overflows."""

    def found(points: np.ndarray) -> np.ndarray:
        with np.errstate(over="ignore", invalid="ignore"):
            log = log_likelihood(points)
        return np.asarray(np.where(np.isnan(log), -np.inf, log))

    return found


def normal_log_density(points: np.ndarray) -> Float[np.ndarray, " point"]:
    """Logarithm of the standard normal density."""
    size = points.shape[1]
    return np.asarray(-0.5 * np.sum(points**2, axis=1) - 0.5 * size * np.log(2.0 * np.pi))


def _climbed(
    log_likelihood: Callable[[np.ndarray], np.ndarray],
    log_prior: Callable[[np.ndarray], np.ndarray],
    starts: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Maximum from the likeliest start, and a root of the covariance by its curvature."""

    def objective(points: np.ndarray) -> np.ndarray:
        return np.asarray(log_likelihood(points) + log_prior(points))

    prior = HyperparameterPrior(np.zeros(starts.shape[1]), np.ones(starts.shape[1]))
    best = climb(objective, starts[int(objective(starts).argmax())], prior, difference=NARROW)
    return best.point, WIDER * np.linalg.cholesky(np.linalg.inv(best.curvature))


def _even(points: int, dimensions: int) -> tuple[np.ndarray, np.ndarray]:
    uniform = scipy.stats.qmc.Halton(dimensions + 1, scramble=False).random(points + 1)[1:]
    radial = np.sqrt(FREEDOM / chdtri(FREEDOM, 1.0 - uniform[:, -1]))
    return np.asarray(ndtri(uniform[:, :-1])), np.asarray(radial)


def _mixed(
    densities: list[Callable[[np.ndarray], np.ndarray]], points: np.ndarray
) -> np.ndarray:
    each = np.array([density(points) for density in densities])
    return np.asarray(logsumexp(each, axis=0) - np.log(len(densities)))


def _fitted(points: np.ndarray, log: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and root of the covariance of weighted points, tempered until enough count."""
    weight = np.zeros(len(points))
    for _ in range(60):
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        if 1.0 / np.sum(weight**2) >= TEMPERED:
            break
        log = 0.7 * log
    mean = weight @ points
    around = points - mean
    covariance = (around * weight[:, None]).T @ around
    return mean, np.linalg.cholesky(covariance + 1e-10 * np.eye(points.shape[1]))


def _t_density(mean: np.ndarray, factor: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    size = len(mean)
    constant = (
        gammaln(0.5 * (FREEDOM + size))
        - gammaln(0.5 * FREEDOM)
        - 0.5 * size * np.log(FREEDOM * np.pi)
        - np.log(np.diag(factor)).sum()
    )
    inverse = np.linalg.inv(factor)

    def density(points: np.ndarray) -> np.ndarray:
        away = np.sum(((points - mean) @ inverse.T) ** 2, axis=1)
        return np.asarray(constant - 0.5 * (FREEDOM + size) * np.log1p(away / FREEDOM))

    return density

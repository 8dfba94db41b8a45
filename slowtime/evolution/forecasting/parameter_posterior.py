"""Posterior of process parameters: weighted points and model evidence."""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from slowtime.estimation import hyperparameters
from slowtime.estimation.hyperparameters import HyperparameterPrior, ObjectiveOptimum

Points = Float[np.ndarray, "family parameter"]
Likelihood = Callable[[np.ndarray], np.ndarray]
"""Points, one a row, to the logarithm of the likelihood of the history at each."""

NET = 32
"""Points tried over the prior, and again about the optimum."""

_WIDER = 1.3  # proposal over Laplace width, so that weights stay bounded
_NEGLIGIBLE = 1e-3


@dataclasses.dataclass(frozen=True, slots=True)
class ParameterPosterior:
    """Parameters that a history allows.

    Parameters
    ----------
    points, weights
        Logarithms of parameters, and the posterior probability of each point.
    log_evidence
        Of the history under this kind of process, parameters averaged over their prior.
    best
        Where the posterior is highest.
    """

    points: Points
    weights: Float[np.ndarray, " family"]
    log_evidence: float
    best: Float[np.ndarray, " parameter"]


def learn_parameters(
    likelihood: Likelihood,
    prior: HyperparameterPrior,
    net: Float[np.ndarray, " family"] | None = None,
    *,
    iterations: int = 8,
) -> ParameterPosterior:
    """Climb from the best point of a net, and sample about the optimum and the net together.

    Newton's method, then importance sampling from fixed points: the same history gives the
    same answer, to the last bit.

    Parameters
    ----------
    likelihood
        Of the history.
    prior
        Of the parameters' logarithms.
    net
        Likelihood at the points of ``prior.net(NET)``, where it is known.
    iterations
        Largest number of Newton steps.

    Returns
    -------
    Weighted points of the posterior, and its evidence.
    """

    def objective(points: np.ndarray) -> np.ndarray:
        total: np.ndarray = likelihood(points) + prior.log_density(points)
        return total

    wide = prior.net(NET)
    of_net = likelihood(wide) if net is None else net
    scores = of_net + prior.log_density(wide)
    best = hyperparameters.climb(objective, wide[scores.argmax()], prior, iterations=iterations)
    near = _about(best)
    points = np.concatenate([near, wide])
    logs = np.concatenate([objective(near), scores]) - _log_proposal(points, best, prior)
    top = logs.max()
    weights = np.exp(logs - top)
    # The prior is normalised but for the powers of 2 pi that the proposal lacks as well.
    evidence = top + np.log(weights.mean()) - np.log(prior.sd).sum()
    kept = weights > _NEGLIGIBLE * weights.sum()
    weights = weights[kept] / weights[kept].sum()
    return ParameterPosterior(points[kept], weights, float(evidence), best.point)


def _about(best: ObjectiveOptimum) -> Points:
    """Spread points about the optimum, somewhat wider than its curvature asks for."""
    factor = np.linalg.cholesky(np.linalg.inv(best.curvature))
    normal = hyperparameters.quasi_random_points(NET, len(best.point))
    points: Points = best.point + _WIDER * normal @ factor.T
    return points


def _log_proposal(
    points: Points, best: ObjectiveOptimum, prior: HyperparameterPrior
) -> Float[np.ndarray, " family"]:
    """Logarithm of the density that points about the optimum and of the net have together.

    The net reaches where the posterior has a tail that the optimum does not see, as when the
    readings allow that there is no Matérn process at all.
    """
    precision = best.curvature / _WIDER**2
    away = points - best.point
    near = 0.5 * np.linalg.slogdet(precision)[1] - 0.5 * np.einsum(
        "fi,ij,fj->f", away, precision, away
    )
    wide = prior.log_density(points) - np.log(prior.sd).sum()
    together: Float[np.ndarray, " family"] = np.logaddexp(near, wide) - np.log(2.0)
    return together

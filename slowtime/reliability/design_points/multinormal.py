"""Probabilities of unions and intersections of half-spaces (multivariate normal)."""

from collections.abc import Sequence

import numpy as np
import scipy
from jaxtyping import Float
from scipy.special import ndtr, ndtri

from slowtime.reliability.result import DesignPoint

MOST = 40
"""Half-spaces beyond which the distribution function takes too long: the nearest are kept."""

JITTER = 1e-9


def orthant(
    betas: Float[np.ndarray, " part"],
    correlation: Float[np.ndarray, "part part"],
    rng: np.random.Generator,
) -> float:
    r"""Probability :math:`\Phi_m(\beta; R)` that standard normal variables stay below limits.

    Limits are in standard deviations.
    """
    if len(betas) == 1:
        return float(ndtr(betas[0]))
    matrix = np.clip(correlation, -1.0, 1.0)
    np.fill_diagonal(matrix, 1.0 + JITTER)
    law = scipy.stats.multivariate_normal(
        np.zeros(len(betas)), matrix, allow_singular=True, seed=rng.integers(2**31)
    )
    return float(np.clip(law.cdf(betas), 0.0, 1.0))


def sequential(
    betas: Float[np.ndarray, " part"],
    correlation: Float[np.ndarray, "part part"],
    rng: np.random.Generator,
) -> float:
    r"""Probability of the union of events :math:`Z_k > \beta_k`, however small [1].

    As the sum of the probabilities that event k is the first to happen,
    :math:`P(Z_k > \beta_k, Z_j \le \beta_j, j < k)`, each relative to :math:`\Phi(-\beta_k)` by
    random points of the tail: one minus a distribution function would lose its digits.
    """
    order = np.argsort(betas)
    total = 0.0
    for place, k in enumerate(order):
        alone = float(ndtr(-betas[k]))
        before = order[:place]
        if not place:
            total += alone
            continue
        total += alone * _first(betas, correlation, int(k), before, rng)
    return min(total, 1.0)


POINTS = 4000


def _first(
    betas: np.ndarray,
    correlation: np.ndarray,
    k: int,
    before: np.ndarray,
    rng: np.random.Generator,
) -> float:
    """Probability that no event of `before` happens, given that k does."""
    tail = ndtr(-betas[k]) * rng.uniform(size=POINTS)
    z = -ndtri(tail)
    rho = correlation[before, k]
    rest = correlation[np.ix_(before, before)] - np.outer(rho, rho)
    values, vectors = np.linalg.eigh(rest)
    factor = vectors * np.sqrt(np.maximum(values, 0.0))
    others = z[:, None] * rho + rng.standard_normal((POINTS, len(before))) @ factor.T
    return float(np.mean((others <= betas[before]).all(axis=1)))


def union_of_halfspaces(points: Sequence[DesignPoint], rng: np.random.Generator) -> float:
    """Probability that at least one tangent plane is passed."""
    near = sorted(points, key=lambda point: point.beta)[:MOST]
    betas = np.array([point.beta for point in near])
    alphas = np.stack([point.alpha for point in near])
    return sequential(betas, alphas @ alphas.T, rng)

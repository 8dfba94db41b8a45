r"""Any state, any noise: a cloud of weighted particles (Gordon, Salmond and Smith, 1993).

.. math:: x_k \sim p(\cdot | x_{k-1}, u_k), \quad z_k = h(x_k, u_k) + \nu_k

Particles move by the model and are weighted by the reading. Where the effective sample size
:math:`1 / \sum w_i^2` has fallen too low they are drawn anew, systematically (Kitagawa, 1996).
The belief carries its own seed and count of steps, so that a step is a pure function of it.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import chdtri

from .gaussian import root_of

Cloud = Float[np.ndarray, "*twins particle state"]
_LOG_TWO_PI = float(np.log(2.0 * np.pi))


@dataclasses.dataclass(frozen=True, slots=True)
class Particles:
    """What is believed of a state, as a cloud.

    Parameters
    ----------
    points, weights
        Where the particles are, and their weights, which sum to one.
    seed, count
        Of the random numbers of the next step.
    """

    points: Cloud
    weights: Float[np.ndarray, "*twins particle"]
    seed: int
    count: int = 0

    @property
    def mean(self) -> Float[np.ndarray, "*twins state"]:
        """Of the cloud."""
        return np.asarray((self.weights[..., None, :] @ self.points)[..., 0, :])

    @property
    def covariance(self) -> Float[np.ndarray, "*twins state state"]:
        """Of the cloud: a sum of squares."""
        away = (self.points - self.mean[..., None, :]) * np.sqrt(self.weights)[..., None]
        product = np.swapaxes(away, -1, -2) @ away
        return np.asarray(0.5 * (product + np.swapaxes(product, -1, -2)))

    @property
    def sd(self) -> Float[np.ndarray, "*twins state"]:
        """Standard deviations."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)))

    @property
    def effective(self) -> Float[np.ndarray, "*twins"]:
        """Effective sample size: how many equal weights would say as much."""
        return np.asarray(1.0 / np.sum(self.weights**2, axis=-1))


@dataclasses.dataclass(frozen=True, slots=True)
class ParticleStep:
    """One step; entries as of `gaussian.Step`, `surprise` by the moments of the cloud.

    Parameters
    ----------
    effective
        Sample size after the reading, before drawing anew.
    drawn
        Whether particles were drawn anew.
    """

    predicted: Particles
    updated: Particles
    residual: Float[np.ndarray, "*twins reading"]
    log_likelihood: Float[np.ndarray, "*twins"]
    surprise: Float[np.ndarray, "*twins"]
    used: Int[np.ndarray, "*twins"]
    rejected: Bool[np.ndarray, "*twins"]
    effective: Float[np.ndarray, "*twins"]
    drawn: Bool[np.ndarray, "*twins"]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ParticleFilter:
    """A bootstrap filter.

    Parameters
    ----------
    move
        (points, known, generator) to points one step later, each with a noise of its own.
    read
        (points, known) to what would be read at each, without noise.
    reading_noise
        Covariance of the noise of a reading.
    particles
        How many.
    fewest
        Share of them below which the effective sample size may not fall.
    gate
        Probability below which a reading is rejected; None takes all.
    """

    move: Callable[[np.ndarray, Any, np.random.Generator], np.ndarray]
    read: Callable[[np.ndarray, Any], np.ndarray]
    reading_noise: Float[np.ndarray, "... reading reading"]
    particles: int = 1000
    fewest: float = 0.5
    gate: float | None = None

    def start(
        self,
        mean: Float[np.ndarray, "*twins state"],
        covariance: Float[np.ndarray, "*twins state state"],
        *,
        seed: int = 0,
    ) -> Particles:
        """Draw the cloud of a Gaussian belief one step before the first reading.

        Parameters
        ----------
        mean
            Mean of the state.
        covariance
            Covariance of the state.
        seed
            Seed of the draws.

        Returns
        -------
        The cloud.
        """
        shape = (*mean.shape[:-1], self.particles, mean.shape[-1])
        normal = np.random.default_rng([seed, 0]).standard_normal(shape)
        points = mean[..., None, :] + normal @ np.swapaxes(root_of(covariance), -1, -2)
        return Particles(points, np.full(shape[:-1], 1.0 / self.particles), seed, 1)

    def step(
        self,
        belief: Particles,
        reading: Float[np.ndarray, "*twins reading"],
        known: Any = None,
    ) -> tuple[Particles, ParticleStep]:
        """Predict one step, and update by one reading.

        Parameters
        ----------
        belief
            Cloud after the reading before.
        reading
            Reading; NaN entries are missing.
        known
            Input that is passed to `move` and `read`.

        Returns
        -------
        Cloud after the reading, and the details of the step.
        """
        rng = np.random.default_rng([belief.seed, belief.count])
        points = self.move(belief.points, known, rng)
        predicted = Particles(points, belief.weights, belief.seed, belief.count + 1)
        expected = self.read(points, known)
        there = np.broadcast_to(~np.isnan(reading), expected[..., 0, :].shape)
        both = there[..., :, None] & there[..., None, :]
        noise = np.where(both, self.reading_noise, 0.0)
        noise = noise + np.where(there, 0.0, 1.0)[..., None] * np.eye(there.shape[-1])
        residuals = np.where(there[..., None, :], reading[..., None, :] - expected, 0.0)
        surprise, mean = _surprise(residuals, belief.weights, noise)
        number = np.asarray(there.sum(axis=-1))
        rejected = np.zeros(number.shape, dtype=bool)
        if self.gate is not None:
            limit = chdtri(np.maximum(number, 1), self.gate)
            rejected = np.asarray((number > 0) & ~(surprise <= limit))
        use = (number > 0) & ~rejected
        each = _log_density(residuals, noise) - 0.5 * _LOG_TWO_PI * number[..., None]
        with np.errstate(divide="ignore"):
            logs = np.log(belief.weights) + each
        top = logs.max(axis=-1, keepdims=True)
        weights = np.exp(logs - top)
        total = weights.sum(axis=-1, keepdims=True)
        weights = np.where(use[..., None], weights / total, belief.weights)
        seen = dataclasses.replace(predicted, weights=weights)
        drawn = seen.effective < self.fewest * self.particles
        updated = _drawn_anew(seen, np.asarray(drawn), rng)
        likelihood = np.where(use, (top + np.log(total))[..., 0], 0.0)
        return updated, ParticleStep(
            predicted,
            updated,
            np.where(there, mean, np.nan),
            likelihood,
            np.where(number > 0, surprise, 0.0),
            np.where(use, number, 0),
            rejected,
            seen.effective,
            np.asarray(drawn),
        )


def systematic(
    weights: Float[np.ndarray, "*twins particle"], offset: Float[np.ndarray, "*twins"]
) -> Int[np.ndarray, "*twins particle"]:
    """Resample systematically: each particle as often as its share of the draws, to within one.

    Parameters
    ----------
    weights
        Weights of the particles [1].
    offset
        Uniform random number of each twin, in [0, 1).

    Returns
    -------
    Indices of the particles drawn.

    References
    ----------
    .. [1] G. Kitagawa, "Monte Carlo filter and smoother for non-Gaussian nonlinear state space
       models", J. Comput. Graph. Stat. 5 (1996) 1-25.

    Examples
    --------
    >>> systematic(np.array([0.5, 0.0, 0.25, 0.25]), np.array(0.5))
    array([0, 0, 2, 3])
    """
    count = weights.shape[-1]
    edges = np.cumsum(weights, axis=-1).reshape(-1, count)
    edges /= edges[:, -1:]
    marks = ((np.arange(count) + offset[..., None]) / count).reshape(-1, count)
    # One search for all twins: each on a stretch of the line of its own.
    shift = 2.0 * np.arange(len(edges))[:, None]
    found = np.searchsorted((edges + shift).ravel(), (marks + shift).ravel(), side="right")
    own = found.reshape(-1, count) - count * np.arange(len(edges))[:, None]
    return np.asarray(np.minimum(own, count - 1).reshape(weights.shape))


def _drawn_anew(cloud: Particles, drawn: np.ndarray, rng: np.random.Generator) -> Particles:
    offset = rng.random(drawn.shape)
    if not drawn.any():
        return cloud
    index = systematic(cloud.weights, np.asarray(offset))
    points = np.take_along_axis(cloud.points, index[..., None], axis=-2)
    equal = np.full_like(cloud.weights, 1.0 / cloud.weights.shape[-1])
    return dataclasses.replace(
        cloud,
        points=np.where(drawn[..., None, None], points, cloud.points),
        weights=np.where(drawn[..., None], equal, cloud.weights),
    )


def _surprise(
    residuals: np.ndarray, weights: np.ndarray, noise: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Squared mean residual in units of its covariance, and that mean."""
    mean = (weights[..., None, :] @ residuals)[..., 0, :]
    away = (residuals - mean[..., None, :]) * np.sqrt(weights)[..., None]
    spread = np.swapaxes(away, -1, -2) @ away + noise
    return np.asarray(np.sum(mean * np.linalg.solve(spread, mean[..., None])[..., 0], -1)), mean


def _log_density(residuals: np.ndarray, noise: np.ndarray) -> np.ndarray:
    root = np.linalg.cholesky(noise)
    white = np.linalg.solve(root, np.swapaxes(residuals, -1, -2))
    volume = np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1)
    return np.asarray(-0.5 * np.sum(white**2, axis=-2) - volume[..., None])

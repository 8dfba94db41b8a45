r"""Linear Gaussian state, one reading at a time, and back again for the past.

.. math:: x_k = F x_{k-1} + w_k, \quad z_k = H x_k + \nu_k, \qquad
          w_k \sim N(0, Q), \; \nu_k \sim N(0, R)

with both noises white in time and independent of each other and of the start, without which
the recursion is not the batch posterior (the book asks for zero mean and Gaussian only).
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy import linalg


@dataclasses.dataclass(frozen=True, slots=True)
class Gaussian:
    """What is believed of a state."""

    mean: Float[np.ndarray, " state"]
    covariance: Float[np.ndarray, "state state"]


@dataclasses.dataclass(frozen=True, slots=True)
class Filtered:
    """One step of the filter: belief before the reading, after it, and how well it fitted.

    Parameters
    ----------
    predicted, updated
        Belief before and after the reading.
    transition
        What led from the belief of the step before to `predicted`.
    log_likelihood
        Of the reading given all before it [1]; 0 where it is missing.
    surprise
        Squared residual in units of its predicted covariance [1]: its mean over many
        readings is their dimension if the model is right.
    """

    predicted: Gaussian
    updated: Gaussian
    transition: Float[np.ndarray, "state state"]
    log_likelihood: float
    surprise: float


def predict(
    belief: Gaussian,
    transition: Float[np.ndarray, "state state"],
    process_noise: Float[np.ndarray, "state state"],
) -> Gaussian:
    """Belief one step later (eq. 1.22, 1.23)."""
    covariance = transition @ belief.covariance @ transition.T + process_noise
    return Gaussian(transition @ belief.mean, 0.5 * (covariance + covariance.T))


def update(
    belief: Gaussian,
    reading: Float[np.ndarray, " reading"],
    observation: Float[np.ndarray, "reading state"],
    reading_noise: Float[np.ndarray, "reading reading"],
) -> tuple[Gaussian, float, float]:
    """Belief after a reading, its log-likelihood, and its surprise (eq. 1.24 to 1.26).

    NaN entries of the reading are missing: the rest is used. The covariance is updated in
    Joseph's form, symmetric and positive whatever the rounding; eq. 1.26 is printed with a 1
    where the identity matrix belongs.
    """
    seen = ~np.isnan(reading)
    if not seen.any():
        return belief, 0.0, 0.0
    h, noise = observation[seen], reading_noise[np.ix_(seen, seen)]
    residual = reading[seen] - h @ belief.mean
    spread = h @ belief.covariance @ h.T + noise
    factor = linalg.cho_factor(spread, lower=True)
    gain = linalg.cho_solve(factor, h @ belief.covariance).T
    left = np.eye(len(belief.mean)) - gain @ h
    covariance = left @ belief.covariance @ left.T + gain @ noise @ gain.T
    surprise = float(residual @ linalg.cho_solve(factor, residual))
    volume = 2.0 * float(np.log(np.diag(factor[0])).sum()) + seen.sum() * np.log(2.0 * np.pi)
    updated = Gaussian(belief.mean + gain @ residual, 0.5 * (covariance + covariance.T))
    return updated, -0.5 * (surprise + float(volume)), surprise


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Kalman:
    """A filter whose model is the same at every step.

    Parameters
    ----------
    transition, process_noise, observation, reading_noise
        F, Q, H and R of the model.

    Examples
    --------
    A constant level read twice, with a prior as good as one reading:

    >>> level = Kalman(transition=np.eye(1), process_noise=np.zeros((1, 1)),
    ...                observation=np.eye(1), reading_noise=np.eye(1))
    >>> belief = level.start(np.zeros(1), np.eye(1))
    >>> for reading in (3.0, 3.0):
    ...     belief, _ = level.step(belief, np.array([reading]))
    >>> belief.mean.round(9), belief.covariance.round(9)
    (array([2.]), array([[0.33333333]]))
    """

    transition: Float[np.ndarray, "state state"]
    process_noise: Float[np.ndarray, "state state"]
    observation: Float[np.ndarray, "reading state"]
    reading_noise: Float[np.ndarray, "reading reading"]

    def start(
        self, mean: Float[np.ndarray, " state"], covariance: Float[np.ndarray, "state state"]
    ) -> Gaussian:
        """Belief one step before the first reading."""
        if not np.allclose(covariance, covariance.T):
            raise ValueError(
                "The covariance of the start is not symmetric, so it is none. Give the "
                "covariance matrix of the state, not a factor of it."
            )
        return Gaussian(mean, covariance)

    def step(
        self, belief: Gaussian, reading: Float[np.ndarray, " reading"]
    ) -> tuple[Gaussian, Filtered]:
        """One step on, and one reading taken in; a reading of NaN is missing."""
        predicted = predict(belief, self.transition, self.process_noise)
        updated, likelihood, surprise = update(
            predicted, reading, self.observation, self.reading_noise
        )
        return updated, Filtered(predicted, updated, self.transition, likelihood, surprise)

    def run(
        self, belief: Gaussian, readings: Float[np.ndarray, "time reading"]
    ) -> list[Filtered]:
        """Every step over a whole series."""
        steps = []
        for reading in readings:
            belief, step = self.step(belief, reading)
            steps.append(step)
        return steps


def smooth(steps: Sequence[Filtered]) -> list[Gaussian]:
    r"""Belief at each step given all readings, past and future (Rauch, Tung and Striebel).

    .. math:: C_k = P_k F^T (P^-_{k+1})^{-1}, \quad
              x^s_k = x_k + C_k (x^s_{k+1} - x^-_{k+1}), \quad
              P^s_k = P_k + C_k (P^s_{k+1} - P^-_{k+1}) C_k^T
    """
    if not steps:
        return []
    smoothed = [steps[-1].updated]
    for now, after in zip(reversed(steps[:-1]), reversed(steps[1:]), strict=True):
        later = smoothed[-1]
        cross = after.transition @ now.updated.covariance
        gain = np.linalg.lstsq(after.predicted.covariance, cross, rcond=None)[0].T
        mean = now.updated.mean + gain @ (later.mean - after.predicted.mean)
        covariance = (
            now.updated.covariance
            + gain @ (later.covariance - after.predicted.covariance) @ gain.T
        )
        smoothed.append(Gaussian(mean, 0.5 * (covariance + covariance.T)))
    return smoothed[::-1]

r"""Ordinates of a raw periodogram in, the resonance most likely to have scattered them out.

Ordinates :math:`I_k` of a Gaussian record are nearly independent and exponential about their
expectation :math:`S_k(\theta)`; means of :math:`n_k` of them, gamma distributed. Hence

.. math:: -\ln L(\theta) = \sum_k n_k (\ln S_k + I_k / S_k)

(Whittle), with Fisher information
:math:`\sum_k n_k \, \partial \ln S_k \, \partial \ln S_k^T`.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from .spectrum_model import expected_resonance

STEPS = 60
CONVERGED = 1e-4
"""Stop when a scoring step moves no parameter by more than this many standard deviations."""

NEARLY = 0.05
"""A search that stalls, on slopes by differences, before a smaller step passes as done."""

FLOOR_PRIOR = 1e-2
"""Prior information on the logarithm of the floor (sd 10): keeps an invisible one put."""


@dataclasses.dataclass(frozen=True, slots=True)
class Resonance:
    """A fitted resonance: parameters (ln f, ln zeta, ln peak density, ln floor)."""

    parameters: Float[np.ndarray, " parameter"]
    covariance: Float[np.ndarray, "parameter parameter"]
    log_likelihood: float
    expected: Float[np.ndarray, " frequency"]
    converged: bool


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Ordinates:
    """Part of the raw periodogram of one record, and what shapes its expectation.

    `number` ordinates were averaged to each density; see `grouped`.
    """

    frequency_hz: Float[np.ndarray, " frequency"]
    density: Float[np.ndarray, " frequency"]
    number: Float[np.ndarray, " frequency"]
    rate_hz: float
    count: int
    derivatives: int

    def shape(
        self, log_frequency: float, log_damping: float
    ) -> Float[np.ndarray, " frequency"]:
        """Predict the periodogram for unit peak density."""
        return expected_resonance(
            self.frequency_hz,
            natural_hz=float(np.exp(log_frequency)),
            damping_ratio=min(float(np.exp(log_damping)), 0.95),
            rate_hz=self.rate_hz,
            count=self.count,
            derivatives=self.derivatives,
        )


def grouped(data: Ordinates, centre_hz: float) -> Ordinates:
    """Ordinates averaged where the spectrum is smooth: over a twelfth of the way to the peak.

    A resonance falls off like the square of that distance, so averaging loses under 0.2 % of
    its shape, and leaves a few hundred ordinates of however long a record.
    """
    offset = np.abs(data.frequency_hz - centre_hz) * data.count / data.rate_hz
    # Cumulated 1/width passes a whole number wherever one group ends and the next begins.
    group = np.floor(np.cumsum(1.0 / np.maximum(1.0, offset / 12.0)) + 1e-9).astype(int)
    starts = np.flatnonzero(np.diff(group, prepend=-1))
    number = np.diff(starts, append=len(offset)).astype(float)
    whole = np.add.reduceat(data.number, starts)
    return dataclasses.replace(
        data,
        frequency_hz=np.add.reduceat(data.frequency_hz, starts) / number,
        density=np.add.reduceat(data.density * data.number, starts) / whole,
        number=whole,
    )


def fit_resonance(data: Ordinates, start: Float[np.ndarray, " parameter"]) -> Resonance:
    """Maximum of Whittle's likelihood by Fisher scoring with step halving from `start`."""
    theta, damping = start.copy(), 1e-3
    expected, slopes = _linearised(data, theta)
    best = log_likelihood(data, expected)
    left = np.inf
    for _ in range(STEPS):
        information = (slopes * data.number) @ slopes.T
        information[3, 3] += FLOOR_PRIOR
        score = slopes @ (data.number * (data.density / expected - 1.0))
        score[3] -= FLOOR_PRIOR * (theta[3] - start[3])
        scale = np.diag(np.diag(information))
        step = np.linalg.solve(information + damping * scale, score)
        trial = theta + np.clip(step, -1.0, 1.0)
        left = float(step @ information @ step)
        if left < CONVERGED**2:
            break
        if not _possible(data, trial):
            damping = max(damping, 1e-3) * 8.0
            continue
        trial_expected = _expected(data, trial)
        likelihood = log_likelihood(data, trial_expected)
        if likelihood < best - 1e-9 * abs(best):
            damping = max(damping, 1e-3) * 8.0
            if damping > 1e9:
                break
            continue
        theta, best, damping = trial, likelihood, damping / 8.0
        expected, slopes = _linearised(data, theta)
    information = (slopes * data.number) @ slopes.T
    information[3, 3] += FLOOR_PRIOR
    return Resonance(theta, np.linalg.inv(information), best, expected, left < NEARLY**2)


def log_likelihood(data: Ordinates, expected: Float[np.ndarray, " frequency"]) -> float:
    """Whittle's, up to a constant."""
    return float(-np.sum(data.number * (np.log(expected) + data.density / expected)))


def fit_smooth(data: Ordinates) -> float:
    """Greatest likelihood of a spectrum without resonance: a power of frequency."""
    logarithm = np.log(data.frequency_hz / data.frequency_hz.mean())
    rows = np.stack([np.ones_like(logarithm), logarithm])
    theta = np.array([np.log(data.density.mean()), 0.0])
    for _ in range(50):
        expected = np.exp(theta @ rows)
        score = rows @ (data.number * (data.density / expected - 1.0))
        step = np.linalg.solve((rows * data.number) @ rows.T, score)
        theta = theta + np.clip(step, -1.0, 1.0)
        if np.abs(step).max() < 1e-6:
            break
    return log_likelihood(data, np.exp(theta @ rows))


def _possible(data: Ordinates, theta: np.ndarray) -> bool:
    low, high = data.frequency_hz[0], data.frequency_hz[-1]
    return bool(low < np.exp(theta[0]) < high and -12.0 < theta[1] < np.log(0.9))


def _expected(data: Ordinates, theta: np.ndarray) -> np.ndarray:
    peak, floor = np.exp(theta[2:])
    return np.asarray(peak * np.maximum(data.shape(theta[0], theta[1]), 1e-12) + floor)


def _linearised(data: Ordinates, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Predict ordinates and the slopes of their logarithms, central differences for two."""
    peak, floor = np.exp(theta[2:])
    resonance = peak * np.maximum(data.shape(theta[0], theta[1]), 1e-12)
    expected = resonance + floor
    move_f, move_z = 1e-3 * float(np.exp(theta[1])), 1e-3
    slopes = np.stack(
        [
            peak * _difference(lambda h: data.shape(theta[0] + h, theta[1]), move_f),
            peak * _difference(lambda h: data.shape(theta[0], theta[1] + h), move_z),
            resonance,
            np.full_like(expected, floor),
        ]
    )
    return expected, slopes / expected


def _difference(curve: Callable[[float], np.ndarray], move: float) -> np.ndarray:
    return np.asarray((curve(move) - curve(-move)) / (2 * move))

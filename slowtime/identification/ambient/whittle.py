r"""Whittle likelihood of one resonance in a periodogram, maximised by Fisher scoring.

Ordinates :math:`I_k` of a Gaussian record are nearly independent and exponential about their
expectation :math:`S_k(\theta)`; means of :math:`n_k` of them, gamma distributed. Hence

.. math:: -\ln L(\theta) = \sum_k n_k (\ln S_k + I_k / S_k)

(Whittle), with Fisher information
:math:`\sum_k n_k \, \partial \ln S_k \, \partial \ln S_k^T`.
"""

import dataclasses
import math

import numpy as np
from jaxtyping import Bool, Float

from .expected_spectrum import PredictedPeriodogram, expected_resonances

STEPS = 60
"""Scoring steps, at most."""

CONVERGED = 1e-3
"""Length of a scoring step at which the search stops [standard deviations]."""

NEARLY = 0.05
"""Length of the last scoring step below which a stalled search counts as converged [standard
deviations]."""

LEAST_CURVATURE = 0.1
"""[1] Of the expected curvature in any direction, below which what was learnt is forgotten.
Source: but for far from the top, that of a record is within half and twice that expected."""

LEAST_ANGLE = 1e-6
"""[1] Cosine of the angle between a step and what its score did beyond what was expected, below
which nothing is learnt. Source: rounding of the score."""

FLOOR_PRIOR = 1e-2
"""Prior information on ln floor (sd 10): keeps a floor that is not visible at its initial
value."""

COLOUR_PRIOR = 0.1
"""Prior information on the exponent of the force spectrum about 0 (sd 3)."""

FREQUENCY, DAMPING, PEAK, FLOOR, COLOUR = range(5)
"""Indices of the parameters: ln f, ln zeta, ln peak density, ln floor, exponent of the force
spectrum."""


@dataclasses.dataclass(frozen=True, slots=True)
class ResonanceFit:
    """A fitted resonance: parameters (ln f, ln zeta, ln peak density, ln floor[, colour])."""

    parameters: Float[np.ndarray, " parameter"]
    covariance: Float[np.ndarray, "parameter parameter"]
    log_likelihood: float
    expected: Float[np.ndarray, " frequency"]
    converged: bool


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class PosteriorMaximum:
    """Top of a posterior: where it is, how high, and the covariance that its curvature says."""

    parameters: Float[np.ndarray, " parameter"]
    covariance: Float[np.ndarray, "parameter parameter"]
    log_posterior: float


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Periodogram:
    """Part of the raw periodogram of one record, and what shapes its expectation.

    `number` ordinates were averaged to each density; see `group_ordinates`.
    """

    frequency_hz: Float[np.ndarray, " frequency"]
    density: Float[np.ndarray, " frequency"]
    number: Float[np.ndarray, " frequency"]
    rate_hz: float
    count: int
    derivatives: int

    @property
    def duration_s(self) -> float:
        """Of the record [s]."""
        return self.count / self.rate_hz

    def shapes(
        self, log_frequency: Float[np.ndarray, " case"], log_damping: Float[np.ndarray, " case"]
    ) -> Float[np.ndarray, "case frequency"]:
        """Predict the periodograms of several cases for unit peak density.

        One row for each case of ln f, f in Hz, and ln zeta.
        """
        return expected_resonances(
            self.frequency_hz,
            natural_hz=np.exp(log_frequency),
            damping_ratio=np.minimum(np.exp(log_damping), 0.95),
            rate_hz=self.rate_hz,
            count=self.count,
            derivatives=self.derivatives,
        )

    def within(self, low_hz: float, high_hz: float) -> "Periodogram":
        """Ordinates between two frequencies."""
        inside = (self.frequency_hz >= low_hz) & (self.frequency_hz <= high_hz)
        return dataclasses.replace(
            self,
            frequency_hz=self.frequency_hz[inside],
            density=self.density[inside],
            number=self.number[inside],
        )


def group_ordinates(data: Periodogram, centre_hz: float) -> Periodogram:
    """Average neighbouring ordinates over a twelfth of their distance from the peak."""
    # A resonance falls off like the square of that distance, so averaging loses under 0.2 % of
    # its shape, and leaves a few hundred ordinates of however long a record.
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


def fit_resonance(
    data: Periodogram,
    start: Float[np.ndarray, " parameter"],
    *,
    held: tuple[int, ...] = (),
) -> ResonanceFit:
    """Maximise the Whittle likelihood by Fisher scoring, corrected by what steps teach.

    Where floor, colour and damping say nearly the same, the curvature of a record is up to
    twice that expected, and plain scoring goes to and fro. What is between them is learnt from
    the change of the score over each step (a structured secant [1]_, by symmetric updates of
    rank one).

    It starts from four parameters for a white force, five for one of unknown colour. Those at
    the places `held` stay where they are; their covariance is 0.

    References
    ----------
    .. [1] J. E. Dennis, D. M. Gay and R. E. Welsch, "An adaptive nonlinear least-squares
       algorithm", ACM TOMS 7 (1981).
    """
    prior, before = _prior(start), _expected_before(start)
    free = np.array([k not in held for k in range(len(start))])
    model = _Model(data)

    def at(theta: np.ndarray) -> _Point:
        expected, slopes = model.at(theta)
        score = slopes @ (data.number * (data.density / expected - 1.0))
        return _Point(
            theta, expected, score - prior * (theta - before),
            (slopes * data.number) @ slopes.T + np.diag(prior),
            whittle_log_likelihood(data, expected) - 0.5 * prior @ (theta - before) ** 2,
        )  # fmt: skip

    here, damping, left = at(start), 1e-3, np.inf
    beyond, within = np.zeros_like(here.information), np.ix_(free, free)
    for _ in range(STEPS):
        if not _curves_enough(here.information[within], beyond[within]):
            beyond = np.zeros_like(beyond)
        damped = here.information + beyond
        damped[np.diag_indices_from(damped)] *= 1 + damping
        step = np.zeros(len(start))
        step[free] = np.linalg.solve(damped[within], here.score[free])
        left = float(step @ here.information @ step)
        if left < CONVERGED**2:
            break
        step = np.clip(step, -1.0, 1.0)
        if not _possible(data, here.theta + step):
            damping = max(damping, 1e-3) * 8.0
            continue
        there = at(here.theta + step)
        beyond = beyond + _learnt(here, there, step, beyond)
        if not there.height >= here.height - 1e-9 * abs(here.height):
            damping = max(damping, 1e-3) * 8.0
            if damping > 1e9:
                break
            continue
        here, damping = there, damping / 8.0
    covariance = _inverse(here.information, free)
    return ResonanceFit(here.theta, covariance, here.height, here.expected, left < NEARLY**2)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Point:
    """Where a search is: ordinates expected there, score, information and log-posterior."""

    theta: np.ndarray
    expected: np.ndarray
    score: np.ndarray
    information: np.ndarray
    height: float


def _curves_enough(information: np.ndarray, beyond: np.ndarray) -> bool:
    """Whether curvature is nowhere less than `LEAST_CURVATURE` of that expected.

    Then the rest is positive definite, which Cholesky's method tells for a tenth of what the
    eigenvalues cost.
    """
    if not beyond.any():
        return True
    try:
        np.linalg.cholesky((1 - LEAST_CURVATURE) * information + beyond)
    except np.linalg.LinAlgError:
        return False
    return True


def _learnt(here: _Point, there: _Point, step: np.ndarray, beyond: np.ndarray) -> np.ndarray:
    """Update of rank one by which the curvature explains the change of the score."""
    missing = here.score - there.score - (there.information + beyond) @ step
    along = float(missing @ step)
    size = math.sqrt(float(missing @ missing) * float(step @ step))
    if not abs(along) > LEAST_ANGLE * size:
        return np.zeros_like(beyond)
    return np.outer(missing, missing) / along


def whittle_log_likelihood(
    data: Periodogram, expected: Float[np.ndarray, " frequency"]
) -> float:
    """Whittle log-likelihood, up to a constant."""
    return float(-np.sum(data.number * (np.log(expected) + data.density / expected)))


def smooth_log_likelihood(data: Periodogram) -> float:
    """Largest Whittle log-likelihood of a spectrum without resonance: a power law."""
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
    return whittle_log_likelihood(data, np.exp(theta @ rows))


def _prior(start: np.ndarray) -> np.ndarray:
    """Prior information on each parameter."""
    return np.array([0.0, 0.0, 0.0, FLOOR_PRIOR, COLOUR_PRIOR][: len(start)])


def _expected_before(start: np.ndarray) -> np.ndarray:
    """Where the prior has its middle: the floor as it was guessed, and a white force."""
    return np.append(start[:COLOUR], 0.0)[: len(start)]


def _inverse(information: np.ndarray, free: Bool[np.ndarray, " parameter"]) -> np.ndarray:
    covariance = np.zeros_like(information)
    covariance[np.ix_(free, free)] = np.linalg.inv(information[np.ix_(free, free)])
    return covariance


def _possible(data: Periodogram, theta: np.ndarray) -> bool:
    low, high = data.frequency_hz[0], data.frequency_hz[-1]
    return bool(low < math.exp(theta[0]) < high and -12.0 < theta[1] < math.log(0.9))


class _Model:
    """Ordinates that parameters predict, and the slopes of their logarithms."""

    def __init__(self, data: Periodogram) -> None:
        self.resonance = PredictedPeriodogram(
            data.frequency_hz, data.rate_hz, data.count, data.derivatives
        )
        self.log_frequency = np.log(data.frequency_hz)

    def at(
        self, theta: Float[np.ndarray, " parameter"]
    ) -> tuple[Float[np.ndarray, " frequency"], Float[np.ndarray, "parameter frequency"]]:
        frequency, damping, peak, floor = np.exp(theta[:COLOUR]).tolist()
        shape, moved = self.resonance.at(frequency, min(damping, 0.95))
        shape = np.maximum(shape, 1e-12)
        away = self.log_frequency - theta[FREQUENCY]
        # Density of the force relative to that at the resonance.
        force = peak * np.exp(theta[COLOUR] * away) if len(theta) > COLOUR else peak
        resonance = force * shape
        expected = resonance + floor
        slopes = np.empty((len(theta), len(expected)))
        slopes[:PEAK] = force * moved
        slopes[PEAK], slopes[FLOOR] = resonance, floor
        if len(theta) > COLOUR:
            slopes[FREQUENCY] -= theta[COLOUR] * resonance
            slopes[COLOUR] = resonance * away
        return expected, slopes / expected

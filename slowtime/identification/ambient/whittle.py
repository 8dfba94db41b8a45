r"""Whittle likelihood of one resonance in a periodogram, maximised by Fisher scoring.

Ordinates :math:`I_k` of a Gaussian record are nearly independent and exponential about their
expectation :math:`S_k(\theta)`; means of :math:`n_k` of them, gamma distributed. Hence

.. math:: -\ln L(\theta) = \sum_k n_k (\ln S_k + I_k / S_k)

(Whittle), with Fisher information
:math:`\sum_k n_k \, \partial \ln S_k \, \partial \ln S_k^T`.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from .expected_spectrum import expected_resonance, expected_resonances

STEPS = 60
"""Scoring steps, at most."""

CONVERGED = 1e-3
"""Length of a scoring step at which the search stops [standard deviations]."""

NEARLY = 0.05
"""Length of the last scoring step below which a stalled search counts as converged [standard
deviations]."""

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

    def shape(
        self, log_frequency: float, log_damping: float
    ) -> Float[np.ndarray, " frequency"]:
        """Predict the periodogram for unit peak density.

        Parameters
        ----------
        log_frequency
            Ln f, f in Hz.
        log_damping
            Ln zeta.

        Returns
        -------
        Expected density of each ordinate.
        """
        return expected_resonance(
            self.frequency_hz,
            natural_hz=float(np.exp(log_frequency)),
            damping_ratio=min(float(np.exp(log_damping)), 0.95),
            rate_hz=self.rate_hz,
            count=self.count,
            derivatives=self.derivatives,
        )

    def shapes(
        self, log_frequency: Float[np.ndarray, " case"], log_damping: Float[np.ndarray, " case"]
    ) -> Float[np.ndarray, "case frequency"]:
        """Predict the periodograms of several cases for unit peak density.

        Parameters
        ----------
        log_frequency
            Ln f of each case, f in Hz.
        log_damping
            Ln zeta of each case.

        Returns
        -------
        One row per case.
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
        """Ordinates between two frequencies.

        Parameters
        ----------
        low_hz, high_hz
            Limits, both included [Hz].

        Returns
        -------
        Part of the periodogram.
        """
        inside = (self.frequency_hz >= low_hz) & (self.frequency_hz <= high_hz)
        return dataclasses.replace(
            self,
            frequency_hz=self.frequency_hz[inside],
            density=self.density[inside],
            number=self.number[inside],
        )


def group_ordinates(data: Periodogram, centre_hz: float) -> Periodogram:
    """Average neighbouring ordinates over a twelfth of their distance from the peak.

    A resonance falls off like the square of that distance, so averaging loses under 0.2 % of
    its shape, and leaves a few hundred ordinates of however long a record.

    Parameters
    ----------
    data
        Ordinates.
    centre_hz
        Frequency of the peak [Hz].

    Returns
    -------
    Averaged ordinates, with the number in each.
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


def fit_resonance(
    data: Periodogram,
    start: Float[np.ndarray, " parameter"],
    *,
    held: tuple[int, ...] = (),
) -> ResonanceFit:
    """Maximise the Whittle likelihood by Fisher scoring with step halving.

    Parameters
    ----------
    data
        Ordinates, grouped or not.
    start
        Parameters to start from: four for a white force, five for one of unknown colour.
    held
        Places of parameters that stay where they are; their covariance is 0.

    Returns
    -------
    Parameters, their covariance, and the expected density of each ordinate.
    """
    prior = _prior(start)
    free = np.array([k not in held for k in range(len(start))])
    theta, damping = start.copy(), 1e-3
    expected, slopes = _linearised(data, theta)
    best = whittle_log_likelihood(data, expected) - _priced(prior, theta, start)
    left = np.inf
    for _ in range(STEPS):
        information = (slopes * data.number) @ slopes.T + np.diag(prior)
        score = slopes @ (data.number * (data.density / expected - 1.0))
        score = (score - prior * (theta - _expected_before(start)))[free]
        within = information[np.ix_(free, free)]
        scale = np.diag(np.diag(within))
        step = np.zeros(len(theta))
        step[free] = np.linalg.solve(within + damping * scale, score)
        trial = theta + np.clip(step, -1.0, 1.0)
        left = float(step @ information @ step)
        if left < CONVERGED**2:
            break
        if not _possible(data, trial):
            damping = max(damping, 1e-3) * 8.0
            continue
        trial_expected = _expected(data, trial)
        likelihood = whittle_log_likelihood(data, trial_expected) - _priced(prior, trial, start)
        if likelihood < best - 1e-9 * abs(best):
            damping = max(damping, 1e-3) * 8.0
            if damping > 1e9:
                break
            continue
        theta, best, damping = trial, likelihood, damping / 8.0
        expected, slopes = _linearised(data, theta)
    information = (slopes * data.number) @ slopes.T + np.diag(prior)
    return ResonanceFit(theta, _inverse(information, free), best, expected, left < NEARLY**2)


def whittle_log_likelihood(
    data: Periodogram, expected: Float[np.ndarray, " frequency"]
) -> float:
    """Whittle log-likelihood, up to a constant.

    Parameters
    ----------
    data
        Ordinates.
    expected
        Expected density of each.

    Returns
    -------
    Log-likelihood.
    """
    return float(-np.sum(data.number * (np.log(expected) + data.density / expected)))


def smooth_log_likelihood(data: Periodogram) -> float:
    """Largest Whittle log-likelihood of a spectrum without resonance: a power law.

    Parameters
    ----------
    data
        Ordinates.

    Returns
    -------
    Log-likelihood.
    """
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


def _priced(prior: np.ndarray, theta: np.ndarray, start: np.ndarray) -> float:
    return 0.5 * float(prior @ (theta - _expected_before(start)) ** 2)


def _inverse(information: np.ndarray, free: Bool[np.ndarray, " parameter"]) -> np.ndarray:
    covariance = np.zeros_like(information)
    covariance[np.ix_(free, free)] = np.linalg.inv(information[np.ix_(free, free)])
    return covariance


def _possible(data: Periodogram, theta: np.ndarray) -> bool:
    low, high = data.frequency_hz[0], data.frequency_hz[-1]
    return bool(low < np.exp(theta[0]) < high and -12.0 < theta[1] < np.log(0.9))


def _coloured(data: Periodogram, theta: np.ndarray) -> Float[np.ndarray, " frequency"]:
    """Density of the force relative to that at the resonance."""
    if len(theta) <= COLOUR:
        return np.ones(len(data.frequency_hz))
    return np.asarray(np.exp(theta[COLOUR] * (np.log(data.frequency_hz) - theta[FREQUENCY])))


def _expected(data: Periodogram, theta: np.ndarray) -> np.ndarray:
    peak, floor = np.exp(theta[[PEAK, FLOOR]])
    shape = np.maximum(data.shape(theta[FREQUENCY], theta[DAMPING]), 1e-12)
    return np.asarray(peak * shape * _coloured(data, theta) + floor)


def _linearised(data: Periodogram, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Predict ordinates and the slopes of their logarithms, central differences for two."""
    peak, floor = np.exp(theta[[PEAK, FLOOR]])
    move_f, move_z = 1e-3 * float(np.exp(theta[DAMPING])), 1e-3
    shapes = data.shapes(
        theta[FREQUENCY] + move_f * np.array([0.0, 1.0, -1.0, 0.0, 0.0]),
        theta[DAMPING] + move_z * np.array([0.0, 0.0, 0.0, 1.0, -1.0]),
    )
    force = peak * _coloured(data, theta)
    resonance = force * np.maximum(shapes[0], 1e-12)
    expected = resonance + floor
    slopes = [
        force * (shapes[1] - shapes[2]) / (2 * move_f),
        force * (shapes[3] - shapes[4]) / (2 * move_z),
        resonance,
        np.full_like(expected, floor),
    ]
    if len(theta) > COLOUR:
        slopes[FREQUENCY] = slopes[FREQUENCY] - theta[COLOUR] * resonance
        slopes.append(resonance * (np.log(data.frequency_hz) - theta[FREQUENCY]))
    return expected, np.stack(slopes) / expected

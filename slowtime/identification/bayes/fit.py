"""A band and a start in; the most probable modes and the covariance of their parameters out."""

import dataclasses

import numpy as np
from jaxtyping import Float

from .likelihood import log_posterior, slope, slope_and_information
from .model import Band, Modes, modes_of, vector_of

STEPS = 60
NEAR = 0.1
CONVERGED = 0.01
"""Scoring hands over to Newton, and Newton stops, when a step has fewer standard deviations."""

NEWTON_STEPS = 8

STALLED = 1e9
FIRST_DAMPING = 1e-2

LONGEST_STEP = 0.7
"""Of ln zeta and of ln f in half-bandwidths; more is a leap into the dark."""

DIFFERENCE = 1e-3
"""Of the numerical Hessian, in standard deviations."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class BandFit:
    """Modes of one band; `covariance` is that of `vector_of(modes)`."""

    modes: Modes
    covariance: Float[np.ndarray, "parameter parameter"]
    log_posterior: float
    converged: bool
    band_hz: tuple[float, float]


def fit_band(band: Band, start: Modes) -> BandFit:
    """Maximum of the posterior by Fisher scoring with a trust region, and its curvature.

    The covariance is the inverse of the Hessian of the negative log-posterior; where that is
    not positive (short records), of the Fisher information.
    """
    vector, near = _climb(band, start)
    hessian = _hessian(band, vector, start)
    vector, close = _polished(band, vector, start, np.linalg.inv(hessian))
    return BandFit(
        modes=modes_of(vector, start),
        covariance=np.linalg.inv(hessian),
        log_posterior=log_posterior(band, vector, start),
        converged=near and close,
        band_hz=(float(band.frequency_hz[0]), float(band.frequency_hz[-1])),
    )


def rough_fit(band: Band, start: Modes) -> Modes:
    """Modes within a fraction of their errors, which are not worked out."""
    vector, _ = _climb(band, start)
    return modes_of(vector, start)


def _climb(band: Band, start: Modes) -> tuple[np.ndarray, bool]:
    """Fisher scoring, which finds its way from afar."""
    number = start.number
    vector = vector_of(start)
    best = log_posterior(band, vector, start)
    damping = FIRST_DAMPING
    uphill, information = slope_and_information(band, vector, start)
    for _ in range(STEPS):
        scale = np.diag(np.diag(information))
        step = np.linalg.solve(information + damping * scale, uphill)
        step *= min(1.0, LONGEST_STEP / _leap(step, vector, number))
        if step @ information @ step < NEAR**2:
            return vector, True
        trial = vector + step
        possible = _possible(band, trial, number)
        found = log_posterior(band, trial, start) if possible else -np.inf
        if found < best - 1e-9 * abs(best):
            damping = max(8.0 * damping, FIRST_DAMPING)
            if damping > STALLED:
                break
            continue
        vector, best, damping = trial, found, damping / 8.0
        uphill, information = slope_and_information(band, vector, start)
    return vector, False


def _polished(
    band: Band, vector: np.ndarray, start: Modes, covariance: np.ndarray
) -> tuple[np.ndarray, bool]:
    """Newton's steps with the one Hessian that the errors need anyway."""
    for _ in range(NEWTON_STEPS):
        uphill = slope(band, vector, start)
        step = covariance @ uphill
        distance = float(np.sqrt(max(step @ uphill, 0.0)))
        if distance < CONVERGED:
            return vector, True
        if distance > 2.0 or not _possible(band, vector + step, start.number):
            break
        vector = vector + step
    return vector, False


def _leap(step: np.ndarray, vector: np.ndarray, number: int) -> float:
    in_widths = np.abs(step[:number]) / np.exp(vector[number : 2 * number])
    return float(max(in_widths.max() / 2.0, np.abs(step[number : 2 * number]).max(), 1e-12))


def _possible(band: Band, vector: np.ndarray, number: int) -> bool:
    frequency = np.exp(vector[:number])
    inside = (frequency > band.frequency_hz[0]) & (frequency < band.frequency_hz[-1])
    damping = vector[number : 2 * number]
    return bool(inside.all() and (damping > -12.0).all() and (damping < np.log(0.9)).all())


def _hessian(
    band: Band, vector: np.ndarray, start: Modes
) -> Float[np.ndarray, "parameter parameter"]:
    """Minus the second derivatives by central differences; Fisher's where not positive."""
    information = slope_and_information(band, vector, start)[1]
    rows = []
    for i, move in enumerate(DIFFERENCE * np.sqrt(np.diag(np.linalg.inv(information)))):
        change = np.zeros_like(vector)
        change[i] = move
        after = slope(band, vector + change, start)
        before = slope(band, vector - change, start)
        rows.append((before - after) / (2 * move))
    hessian = np.stack(rows)
    hessian = 0.5 * (hessian + hessian.T)
    return hessian if np.linalg.eigvalsh(hessian)[0] > 0 else information

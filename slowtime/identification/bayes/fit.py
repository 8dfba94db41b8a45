"""Maximum of the posterior of one band, and the covariance of its parameters."""

import dataclasses

import numpy as np
from jaxtyping import Float

from .band import Band, coloured
from .likelihood import gradient, gradient_and_information, log_posterior
from .model import BandModes, modes_from_vector, parameter_vector

STEPS = 60
"""Scoring steps, at most."""

ROUGH_STEPS = 20
"""The same of a fit that only says where the tails of modes reach. Source: of 57 such fits of a
tower under one shaker 7 ended within 20 steps, 8 within 41, the others not within 60."""

NEAR = 0.1
"""Length of a step at which Newton's method replaces scoring [standard deviations]."""

CLOSE = 0.02
"""Length of a step at which the search stops [standard deviations]."""

STALLED = 1e9
"""Damping of the steps at which the search is given up."""

FIRST_DAMPING = 1e-2
"""Initial damping of the steps, relative to the information."""


ROUNDS = 3
"""Evaluations of the Hessian, at most."""

MOVED = 0.5
"""Distance after which the Hessian is evaluated again [standard deviations]."""

LONGEST_STEP = 0.7
"""Longest step of ln zeta, and of the frequency [half-bandwidths]."""

DIFFERENCE = 1e-3
"""Step of the numerical Hessian [standard deviations]."""


COLOUR_STEP = 0.5
"""Step of the exponent of the colour [1], in which the top of the posterior is bracketed."""

COLOUR_SD = 2.0
"""Prior standard deviation of the exponent of the colour [1]: velocities of a structure under
white forces, taken for accelerations, have -1, displacements -2."""

COLOUR_ROUNDS = 6
"""Steps from the exponent 0 to that of the largest posterior, at most."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class BandPosterior:
    """Modes of one band; `covariance` is that of `vector_of(modes)`."""

    modes: BandModes
    covariance: Float[np.ndarray, "parameter parameter"]
    log_posterior: float
    converged: bool
    band_hz: tuple[float, float]
    colour: float = 0.0
    """Exponent of the amplitude of the forces over frequency [1]."""


def fit_band(band: Band, start: BandModes) -> BandPosterior:
    """Maximise the posterior by Fisher scoring and Newton steps."""
    # With coherences there are many parameters, so that the Fisher information serves in place
    # of the Hessian; so it does where the Hessian is not positive (short records).
    if start.coherent:
        vector, converged = _climb(band, parameter_vector(start), start, NEAR)
        hessian = gradient_and_information(band, vector, start)[1]
    else:
        vector, hessian, converged = _by_newton(band, start)
    return BandPosterior(
        modes=modes_from_vector(vector, start),
        covariance=np.linalg.inv(hessian),
        log_posterior=log_posterior(band, vector, start),
        converged=converged,
        band_hz=(float(band.frequency_hz[0]), float(band.frequency_hz[-1])),
    )


def fit_coloured_band(band: Band, start: BandModes) -> BandPosterior:
    r"""Maximise the posterior of a band in which the forces are coloured.

    The density of the forces is taken for :math:`(f / f_0)^{2p}` within the band, because a
    slope of it moves a resonance more than the errors under a white one allow. What is not
    known of p is in the covariance. Where modes have forces in common, their interference
    tells more of a band than a slope does, and forces are taken for white.
    """
    if start.coherent:
        return fit_band(band, start)
    tried: dict[int, tuple[float, np.ndarray]] = {}

    def evaluated(k: int) -> tuple[float, np.ndarray]:
        if k not in tried:
            p = k * COLOUR_STEP
            white, jacobian = coloured(band, p)
            vector, _ = _climb(white, parameter_vector(start), start, NEAR)
            height = log_posterior(white, vector, start) + jacobian - 0.5 * (p / COLOUR_SD) ** 2
            tried[k] = height, vector
        return tried[k]

    best = 0
    for _ in range(COLOUR_ROUNDS):
        at = max((best - 1, best, best + 1), key=lambda k: evaluated(k)[0])
        if at == best:
            break
        best = at
    (low, before), (top, _), (high, after) = (evaluated(best + k) for k in (-1, 0, 1))
    curvature = (2 * top - low - high) / COLOUR_STEP**2
    if not curvature > 0:
        return fit_band(band, start)
    away = np.clip((high - low) / (2 * COLOUR_STEP * curvature), -COLOUR_STEP, COLOUR_STEP)
    colour = best * COLOUR_STEP + float(away)
    found = fit_band(coloured(band, colour)[0], start)
    slope = (after - before) / (2 * COLOUR_STEP)
    whole = found.covariance + np.outer(slope, slope) / curvature
    return dataclasses.replace(found, covariance=whole, colour=colour)


def _by_newton(band: Band, start: BandModes) -> tuple[np.ndarray, np.ndarray, bool]:
    """Top, Hessian there, and whether it is the top."""
    vector, _ = _climb(band, parameter_vector(start), start, NEAR)
    for _ in range(ROUNDS):
        hessian = _hessian(band, vector, start)
        before = vector
        vector, converged = _climb(band, vector, start, CLOSE, hessian)
        moved = vector - before
        if converged and moved @ hessian @ moved < MOVED**2:
            break
    return vector, hessian, converged


def rough_fit(band: Band, start: BandModes) -> BandModes:
    """Most probable modes to within a fraction of their errors, without a covariance."""
    vector, _ = _climb(band, parameter_vector(start), start, NEAR, most=ROUGH_STEPS)
    return modes_from_vector(vector, start)


def _climb(
    band: Band,
    vector: np.ndarray,
    start: BandModes,
    tolerance: float,
    hessian: np.ndarray | None = None,
    *,
    most: int = STEPS,
) -> tuple[np.ndarray, bool]:
    """Go uphill, each step damped until it rises: Fisher scoring, or Newton by one Hessian."""
    best = log_posterior(band, vector, start)
    damping = FIRST_DAMPING if hessian is None else 0.0
    uphill, metric = _local(band, vector, start, hessian)
    for _ in range(most):
        if uphill @ np.linalg.solve(metric, uphill) < tolerance**2:
            return vector, True
        step = np.linalg.solve(metric + damping * np.diag(np.diag(metric)), uphill)
        step *= min(1.0, LONGEST_STEP / _leap(step, vector, start.number))
        trial = vector + step
        possible = _possible(band, trial, start.number)
        found = log_posterior(band, trial, start) if possible else -np.inf
        if found < best - 1e-12 * abs(best):
            damping = max(8.0 * damping, FIRST_DAMPING)
            if damping > STALLED:
                break
            continue
        vector, best, damping = trial, found, damping / 8.0
        uphill, metric = _local(band, vector, start, hessian)
    return vector, False


def _local(
    band: Band, vector: np.ndarray, start: BandModes, hessian: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    if hessian is None:
        return gradient_and_information(band, vector, start)
    return gradient(band, vector, start), hessian


def _leap(step: np.ndarray, vector: np.ndarray, number: int) -> float:
    in_widths = np.abs(step[:number]) / np.exp(vector[number : 2 * number])
    return float(max(in_widths.max() / 2.0, np.abs(step[number : 2 * number]).max(), 1e-12))


def _possible(band: Band, vector: np.ndarray, number: int) -> bool:
    frequency = np.exp(vector[:number])
    inside = (frequency > band.frequency_hz[0]) & (frequency < band.frequency_hz[-1])
    damping = vector[number : 2 * number]
    return bool(inside.all() and (damping > -12.0).all() and (damping < np.log(0.9)).all())


def _hessian(
    band: Band, vector: np.ndarray, start: BandModes
) -> Float[np.ndarray, "parameter parameter"]:
    """Minus the second derivatives by central differences; Fisher's where not positive."""
    information = gradient_and_information(band, vector, start)[1]
    rows = []
    for i, move in enumerate(DIFFERENCE * np.sqrt(np.diag(np.linalg.inv(information)))):
        change = np.zeros_like(vector)
        change[i] = move
        after = gradient(band, vector + change, start)
        before = gradient(band, vector - change, start)
        rows.append((before - after) / (2 * move))
    hessian = np.stack(rows)
    hessian = 0.5 * (hessian + hessian.T)
    return hessian if np.linalg.eigvalsh(hessian)[0] > 0 else information

"""Detection of a period in a history, and a periodic process for it.

A day, a season, a tank that is filled and emptied: trend and Matérn process as ever, and beside
them a function of any form that comes again and slowly changes.
"""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.special import fdtrc

from slowtime.estimation.hyperparameters import HyperparameterPrior
from slowtime.estimation.matern import SlowProcess
from slowtime.estimation.processes import Matern, Sum, Trend, quasi_periodic

Usable = Float[np.ndarray, " usable"]

HARMONICS = 4
"""Harmonics of a smooth wave."""

EDGED = 8
"""Harmonics of a wave that jumps or bends."""

_FEWEST = 12
"""Readings, below which no period is looked for."""

_ROUNDS = 2.0
"""Periods that a history must hold."""

_MOST_ROUNDS = 60.0
"""Periods in a history beyond which none is looked for."""

_FASTEST = 0.45
"""Rounds between neighbouring readings beyond which none is looked for."""

_WIDTH = 0.15
"""Of the prior of a period once it was found, in rounds."""

_AS_GOOD = 2.0
"""Logarithm of a likelihood ratio below which the shorter of two periods is taken."""

_SUSPICION = 1e-4
"""Chance that white noise shows a wave as clear at any period, below which one is tried."""


@dataclasses.dataclass(frozen=True, slots=True)
class Repeating:
    """Processes that repeat themselves, as a history allows them.

    Parameters
    ----------
    family, weights
        The processes, and the probability of each.
    log_evidence
        As of `learning.Learnt`.
    """

    family: Sum
    weights: Float[np.ndarray, " family"]
    log_evidence: float


def period_of(time: Usable, value: Usable, sd: Usable) -> float | None:
    """Period of a two-harmonic wave that explains most; None if it explains little.

    Least squares about a parabola, at periods from two readings to half the history.

    Parameters
    ----------
    time
        Times of the readings [slow time].
    value
        Readings; NaN where there is none.
    sd
        Standard deviations of the readings, in their unit.

    Returns
    -------
    Period [slow time], or None.
    """
    span = float(time[-1] - time[0])
    gap = float(np.median(np.diff(time)))
    if len(time) < _FEWEST or not gap > 0.0:
        return None
    rounds = rounds_of(time)
    if not len(rounds):
        return None
    weight = 1.0 / np.maximum(sd, 1e-6 * np.std(value))
    straight = np.vander((time - time[0]) / span, 3) * weight[:, None]
    base, _ = np.linalg.qr(straight)
    left = value * weight
    left = left - base @ (base.T @ left)
    phase = 2.0 * np.pi * rounds[:, None] * (time - time[0]) / span
    waves = np.stack([f(k * phase) for k in (1, 2) for f in (np.cos, np.sin)], axis=-1)
    waves = waves * weight[:, None]
    waves = waves - base @ (base.T @ waves)
    turned, _ = np.linalg.qr(waves)
    shares = np.cumsum((left @ turned) ** 2, axis=-1) / np.sum(left**2)
    # A second harmonic that the readings are too far apart for is another, slower wave.
    fine = 2.0 * rounds <= _FASTEST * span / gap
    share, terms = np.where(fine, shares[:, 3], shares[:, 1]), np.where(fine, 4.0, 2.0)
    free = len(time) - 3.0 - terms
    ratio = share / np.maximum(1.0 - share, 1e-300) * free / terms
    chances = len(rounds) * fdtrc(terms, free, ratio)
    score = -0.5 * len(time) * np.log(np.maximum(1.0 - share, 1e-300))
    score -= 0.5 * terms * np.log(len(time))
    best = _shortest(rounds, score)
    return span / float(rounds[best]) if min(chances[best], 1.0) < _SUSPICION else None


def rounds_of(time: Usable) -> Float[np.ndarray, " tried"]:
    """Numbers of periods in a history that the search tries [1].

    Parameters
    ----------
    time
        Times of the readings [slow time].
    """
    span, gap = float(time[-1] - time[0]), float(np.median(np.diff(time)))
    return np.arange(_ROUNDS, min(_FASTEST * span / gap, _MOST_ROUNDS), 0.25)


def _shortest(rounds: np.ndarray, score: np.ndarray) -> int:
    """Likeliest period, or a half or third of it that explains as much."""
    best = int(score.argmax())
    for times in (3.0, 2.0):
        near = np.flatnonzero(np.abs(rounds - times * rounds[best]) <= 0.5)
        if len(near) and score[near].max() > score[best] - _AS_GOOD:
            return int(near[score[near].argmax()])
    return best


def log_sought(time: Usable, period: float) -> float:
    """Log-ratio of the prior density at a found period to that before the search.

    Before it, all orders of magnitude are as likely.

    Parameters
    ----------
    time
        Times of the readings [slow time].
    period
        Found period [slow time].
    """
    rounds, found = rounds_of(time), float(np.ptp(time)) / period
    before = 1.0 / (found * np.log(rounds[-1] / rounds[0])) if len(rounds) > 1 else np.inf
    return float(max(-np.log(before * _WIDTH * np.sqrt(2.0 * np.pi)), 0.0))


def prior_of(
    period: float, time: Usable, value: Usable, base: SlowProcess, prior: HyperparameterPrior
) -> HyperparameterPrior:
    """Prior of length, spread and drift as without a wave, followed by that of the wave.

    Of the wave: its period, size, roughness within a period, and memory. Once the wave is
    removed from the history, the rest scatters less, and the prior of the Matérn process is
    adapted.

    Parameters
    ----------
    period
        Period of the wave, in slow time.
    time, value
        Slow time and value of each reading.
    base
        Matérn process without a wave.
    prior
        Prior of its parameters.

    Returns
    -------
    Prior of the logarithms of all parameters.
    """
    span = float(time[-1] - time[0])
    phase = 2.0 * np.pi * time / period
    wave = np.column_stack([f(k * phase) for k in (1, 2) for f in (np.cos, np.sin)])
    design = np.column_stack([np.vander((time - time[0]) / span, 2), wave])
    found = np.linalg.lstsq(design, value, rcond=None)[0]
    least = 1e-6 * float(np.max(base.sd))
    size, left = (
        max(float(np.std(each)), least) for each in (wave @ found[2:], value - design @ found)
    )
    about = [period, 2.0 * size, 0.8, 3.0 * span]
    # The likelihood has a peak for each count of waves: the period is sought within one.
    width = [_WIDTH * period / span, 1.0, 0.6, 1.2]
    centre = prior.centre.copy()
    centre[1] += np.log(left / float(np.max(base.sd)))
    return HyperparameterPrior(
        np.append(centre, np.log(about)), np.append(prior.sd, np.maximum(width, 1e-3))
    )


def members(
    base: SlowProcess, points: Float[np.ndarray, "family parameter"], edged: int = 0
) -> Sum:
    """Family of processes with a wave, the level first in the state.

    Parameters
    ----------
    base
        Process without a wave.
    points
        Logarithms of the parameters of each member.
    edged
        Harmonics of a wave that may jump and bend; 0 for a smooth one.

    Returns
    -------
    The family.
    """
    length, sd, drift, period, size, roughness, memory = np.exp(points.T)
    trend = Trend(level_sd=base.level_sd, slope_sd=base.slope_sd, drift=drift)
    wave = quasi_periodic(
        period=period,
        length=roughness,
        sd=size,
        memory=memory,
        harmonics=edged or HARMONICS,
        edges=edged > 0,
    )
    return Sum((trend, Matern(smoothness=1.5, length=length, sd=sd), wave))


def trial(period: float, base: SlowProcess, smooth: np.ndarray, span: float) -> np.ndarray:
    """Parameter points at which a periodic process is tried before it is learnt.

    Trend and Matérn process as learnt without a wave, or a fifth of the latter.

    Parameters
    ----------
    period
        Found period [slow time].
    smooth
        Parameters without a wave.
    span
        Span of the readings.

    Returns
    -------
    One row per point.
    """
    sizes = float(np.max(base.sd)) * np.array([0.4, 1.2])
    choices = np.array(
        [
            (share, size, roughness)
            for share in (1.0, 0.2)
            for size in sizes
            for roughness in (0.5, 1.5)
        ]
    )
    points = np.zeros((len(choices), 7))
    points[:, :3] = smooth
    points[:, 1] += np.log(choices[:, 0])
    points[:, 3], points[:, 6] = np.log(period), np.log(3.0 * span)
    points[:, 4:6] = np.log(choices[:, 1:])
    return points

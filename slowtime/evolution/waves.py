"""Histories that repeat themselves: is there a period, and what process has it.

A day, a season, a tank that is filled and emptied: trend and Matérn process as ever, and beside
them a function of any form that comes again and slowly changes.
"""

import numpy as np
from jaxtyping import Float
from scipy.special import fdtrc

from slowtime.estimation.hyperparameters import Prior
from slowtime.estimation.matern import SlowProcess
from slowtime.estimation.processes import Matern, Sum, Trend, quasi_periodic

Usable = Float[np.ndarray, " usable"]

HARMONICS = 4
_FEWEST = 12
"""Readings, below which no period is looked for."""

_ROUNDS = 2.0
"""Periods that a history must hold."""

_MOST_ROUNDS = 60.0
"""Periods in a history beyond which none is looked for."""

_SUSPICION = 1e-4
"""Chance that white noise shows a wave as clear at any period, below which one is tried."""


def period_of(time: Usable, value: Usable, sd: Usable) -> float | None:
    """Period at which a wave of two harmonics explains most; None where it explains little.

    Least squares about a straight line, at periods from two readings to half the history.
    """
    span = float(time[-1] - time[0])
    gap = float(np.median(np.diff(time)))
    if len(time) < _FEWEST or not gap > 0.0:
        return None
    rounds = np.arange(_ROUNDS, min(0.45 * span / gap, _MOST_ROUNDS), 0.25)
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
    share = np.sum((left @ turned) ** 2, axis=-1) / np.sum(left**2)
    best = int(share.argmax())
    free = len(time) - 7
    ratio = share[best] / max(1.0 - share[best], 1e-300) * free / 4.0
    chance = min(len(rounds) * float(fdtrc(4.0, free, ratio)), 1.0)
    return span / float(rounds[best]) if chance < _SUSPICION else None


def prior_of(period: float, base: SlowProcess, prior: Prior, span: float) -> Prior:
    """Prior of length, spread and drift as without a wave; then of the wave.

    Of the wave: its period, size, roughness within a period, and memory.
    """
    about = [period, float(np.max(base.sd)), 0.8, 3.0 * span]
    # The likelihood has a peak for each count of waves: the period is sought within one.
    width = [0.15 * period / span, 1.0, 0.6, 1.2]
    return Prior(
        np.append(prior.centre, np.log(about)), np.append(prior.sd, np.maximum(width, 1e-3))
    )


def members(base: SlowProcess, points: Float[np.ndarray, "family parameter"]) -> Sum:
    """Family of processes with a wave, the level first in the state."""
    length, sd, drift, period, size, roughness, memory = np.exp(points.T)
    trend = Trend(level_sd=base.level_sd, slope_sd=base.slope_sd, drift=drift)
    wave = quasi_periodic(
        period=period, length=roughness, sd=size, memory=memory, harmonics=HARMONICS
    )
    return Sum((trend, Matern(smoothness=1.5, length=length, sd=sd), wave))


def trial(period: float, base: SlowProcess, smooth: np.ndarray, span: float) -> np.ndarray:
    """Points at which a wave is tried before it is learnt.

    Trend and Matérn process as learnt without a wave, or a fifth of the latter.
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

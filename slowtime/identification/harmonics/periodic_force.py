"""Tells the lines of a periodic broadband force from those of machines.

A record of noise that a generator repeats, or of a multisine, is made of lines at all multiples
of one over the period. There are hundreds of them, at multiples far above those of a machine,
and they are no disturbance: they are the force, seen through the structure.
"""

import numpy as np
from jaxtyping import Float
from scipy.special import bdtrc

from slowtime.identification.estimates import Measured

from .detection import PeakClass
from .families import HIGHEST_ORDER

FLAG = "periodic_force"
"""Flag of modes under such a force; they are known as well as from one period."""

FEWEST_LINES = 12
"""Least number of lines on multiples of one base."""

LEAST_SHARE = 0.8
"""Least share of all lines that are on them [1]."""

REACH_BINS = 0.6
"""Largest distance of a line from its multiple [bins]."""

LEAST_BINS = 4.0
"""Least base [bins]; below, chance puts a third of all lines on multiples."""

PARTS = 8
"""A base is a distance of two lines over a whole number up to this one."""

CHANCE = 1e-6
"""Largest probability that as many unrelated lines are on multiples of some base [1]."""


def periodic_force_base(lines: tuple[Measured, ...], resolution_hz: float) -> float | None:
    """Find the base frequency of a periodic force, one over its period [Hz].

    None where lines are few, or are multiples as of a machine.
    """
    value = np.sort([line.value for line in lines])
    if len(value) < FEWEST_LINES:
        return None
    apart = np.diff(value)
    tried = np.unique((apart[:, None] / np.arange(1, PARTS + 1)).round(12).ravel())
    tried = tried[tried >= LEAST_BINS * resolution_hz][::-1]
    for base in tried.tolist():
        fitted = _fitted(value, base, resolution_hz)
        if fitted is None:
            continue
        # Parts of a base fit as well as the base does.
        larger = (_fitted(value, n * fitted, resolution_hz) for n in range(PARTS, 1, -1))
        fitted = next((one for one in larger if one is not None), fitted)
        if np.median(value) <= HIGHEST_ORDER * fitted:
            return None
        if _by_chance(value, fitted, resolution_hz, len(tried)) < CHANCE:
            return fitted
    return None


def without_periodic_force(
    found: tuple[PeakClass, ...], resolution_hz: float
) -> tuple[tuple[PeakClass, ...], float]:
    """Remove the lines of a periodic force from those of machines.

    Beside them, the number of periods of the force in the record; 1 without such a force.
    """
    # A speed and the distance of its sidebands have a common part that is no period.
    own = tuple(line.frequency_hz for line in found if not line.sideband)
    base = periodic_force_base(own, resolution_hz)
    if base is None:
        return found, 1.0
    off = _off(np.array([line.frequency_hz.value for line in found]), base)
    apart = np.abs(off) >= REACH_BINS * resolution_hz
    lines = tuple(line for line, is_apart in zip(found, apart, strict=True) if is_apart)
    return lines, base / resolution_hz


def mean_period(
    samples: Float[np.ndarray, "time channel"], periods: float
) -> Float[np.ndarray, "instant channel"]:
    """Average a record over the periods of its force.

    Gives the record itself where a period is no whole number of samples.
    """
    length, whole = round(len(samples) / periods), int(periods + 0.5 / len(samples) + 1e-3)
    if abs(len(samples) / periods - length) * whole > 0.5 or length * whole > len(samples):
        return samples
    return np.asarray(samples[: length * whole].reshape(whole, length, -1).mean(axis=0))


def _off(value: np.ndarray, base: float) -> np.ndarray:
    return np.asarray(value - base * np.round(value / base))


def _fitted(value: np.ndarray, base: float, resolution_hz: float) -> float | None:
    """Fit a base from the lowest orders up, because a small error is large at high ones."""
    used = FEWEST_LINES // 2
    while True:
        part = value[:used]
        near = np.abs(_off(part, base)) < REACH_BINS * resolution_hz
        if np.mean(near) < LEAST_SHARE or base < LEAST_BINS * resolution_hz:
            return None
        order = np.maximum(np.round(part[near] / base), 1.0)
        base = float(order @ part[near] / (order @ order))
        if used >= len(value):
            return base
        used = min(used + used // 2, len(value))


def _by_chance(value: np.ndarray, base: float, resolution_hz: float, tried: int) -> float:

    near = np.count_nonzero(np.abs(_off(value, base)) < REACH_BINS * resolution_hz)
    meets = min(1.0, 2.0 * REACH_BINS * resolution_hz / base)
    return float(bdtrc(near - 2, len(value) - 1, meets)) * tried

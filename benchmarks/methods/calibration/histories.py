"""Histories of twelve laws, drawn without any code of the forecasts that are judged by them.

Time runs from 0 to 1 over the whole of a history. A law of curves maps standard normal
parameters to curves, so that an oracle can sample its parameters; the walks and the jumps are
random in themselves and are drawn on a grid that is finer than the readings.
"""

import dataclasses
import zlib
from collections.abc import Callable

import numpy as np
from scipy.special import ndtr

INSTANTS = (0.5, 0.62, 0.74, 0.86)
"""Shares of a history after which it is asked whether the threshold is crossed by its end."""

NOISES = (0.003, 0.01, 0.025)
"""Standard deviations of a reading [1]: the changes over a history are 0.1 to 0.6."""

LENGTHS = (80, 160, 320)
"""Readings of a whole history."""

FINE = 8
"""Steps of a walk between two readings."""

CURVE_FINE = 2000
"""Points at which a curve is looked at for its first crossing."""

LEAST = -0.97
"""Change below which nothing goes."""


def between(u: np.ndarray, low: float, high: float) -> np.ndarray:
    """Map standard normal numbers to uniform ones between two ends."""
    return np.asarray(low + (high - low) * ndtr(u))


def between_logs(u: np.ndarray, low: float, high: float) -> np.ndarray:
    """Map standard normal numbers to log-uniform ones between two ends."""
    return np.asarray(np.exp(between(u, np.log(low), np.log(high))))


def _linear(u: np.ndarray, s: np.ndarray) -> np.ndarray:
    return np.asarray(0.01 * u[:, :1] - between(u[:, 1:2], 0.05, 0.5) * s)


def _exponential(u: np.ndarray, s: np.ndarray) -> np.ndarray:
    return np.asarray(0.01 * u[:, :1] + np.expm1(-between(u[:, 1:2], 0.1, 1.5) * s))


def _power(u: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Accelerating: a power between 1.5 and 4 of time."""
    size, exponent = between(u[:, 1:2], 0.1, 0.6), between(u[:, 2:3], 1.5, 4.0)
    return np.asarray(0.01 * u[:, :1] - size * s**exponent)


def _crack(u: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Growth that would be infinite soon after the end, at twice it at the latest."""
    size, end = between_logs(u[:, 1:2], 0.02, 0.15), between_logs(u[:, 2:3], 1.02, 2.0)
    order = between(u[:, 3:4], 0.5, 2.0)
    return np.asarray(
        np.maximum(0.01 * u[:, :1] - size * ((1.0 - s / end) ** -order - 1.0), LEAST)
    )


def _saturating(u: np.ndarray, s: np.ndarray) -> np.ndarray:
    size, rate = between(u[:, 1:2], 0.1, 0.5), between(u[:, 2:3], 2.0, 8.0)
    return np.asarray(0.01 * u[:, :1] + size * np.expm1(-rate * s))


def _oscillating(u: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Fade times oscillation: equation 5.12 of the book, with other parameters."""
    rate, ripple = between(u[:, 0:1], 0.1, 1.0), between(u[:, 1:2], 0.03, 0.15)
    cycles = between_logs(u[:, 2:3], 2.0, 12.0)
    breathing = (1.0 + ripple * np.cos(2.0 * np.pi * cycles * s)) / (1.0 + ripple)
    return np.asarray(np.exp(-rate * s) * breathing - 1.0)


def _seasonal(u: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Line with a season of unknown period, phase and second harmonic."""
    slope, cycles = between(u[:, 1:2], 0.0, 0.3), between_logs(u[:, 2:3], 3.0, 15.0)
    turn = 2.0 * np.pi * cycles * s
    wave = 0.03 * (u[:, 3:4] * np.cos(turn) + u[:, 4:5] * np.sin(turn))
    return np.asarray(
        0.01 * u[:, :1] - slope * s + wave + 0.01 * u[:, 5:6] * np.cos(2.0 * turn)
    )


def _kink(u: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Two lines; the second mostly steeper."""
    first, second = between(u[:, 1:2], 0.0, 0.2), between(u[:, 2:3], 0.0, 0.8)
    bend = between(u[:, 3:4], 0.05, 0.6)
    return np.asarray(
        0.01 * u[:, :1] - first * np.minimum(s, bend) - second * np.maximum(s - bend, 0.0)
    )


def _repair(u: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Draw a line; an unannounced repair takes a share of the damage away."""
    slope, at = between(u[:, 1:2], 0.1, 0.6), between(u[:, 2:3], 0.1, 0.48)
    share = between(u[:, 3:4], 0.3, 1.0)
    return np.asarray(0.01 * u[:, :1] - slope * (s - share * at * (s > at)))


@dataclasses.dataclass(frozen=True, slots=True)
class CurveKind:
    """A law of curves: standard normal parameters [curve, parameter] and times to values."""

    curve: Callable[[np.ndarray, np.ndarray], np.ndarray]
    parameters: int


CURVES = {
    "linear": CurveKind(_linear, 2),
    "exponential": CurveKind(_exponential, 2),
    "accelerating": CurveKind(_power, 3),
    "crack": CurveKind(_crack, 4),
    "saturating": CurveKind(_saturating, 3),
    "oscillating fade": CurveKind(_oscillating, 3),
    "seasonal": CurveKind(_seasonal, 6),
    "kink": CurveKind(_kink, 4),
    "repair": CurveKind(_repair, 4),
}

WALKS = ("random walk", "reverting walk")
JUMPS = "jumps"
LAWS = (*CURVES, *WALKS, JUMPS)


@dataclasses.dataclass(frozen=True, slots=True)
class JumpTruth:
    """Of a history of jumps: how many are expected, and the law of their sizes."""

    rate: float
    mean: float
    sd: float


@dataclasses.dataclass(frozen=True, slots=True)
class InstantCase:
    """One history, and the question that is asked at each of its instants.

    Parameters
    ----------
    time, value
        Times of the readings, from 0 to 1, and readings.
    sd
        Standard deviation of a reading.
    fine, truth
        Times of a fine grid, and the true change there.
    threshold
        Of the question whether the change is below it before the end.
    unit
        Slow times in the whole history.
    parameters, jumps
        Of a curve, its standard normal parameters; of jumps, their law.
    """

    law: str
    number: int
    time: np.ndarray
    value: np.ndarray
    sd: float
    fine: np.ndarray
    truth: np.ndarray
    threshold: float
    unit: float
    parameters: np.ndarray
    jumps: JumpTruth | None

    @property
    def crossed(self) -> float:
        """Time of the first crossing after the first instant; infinite without one."""
        across = (self.truth <= self.threshold) & (self.fine >= INSTANTS[0])
        return float(self.fine[across.argmax()]) if across.any() else np.inf


def case(law: str, number: int, seed: int) -> InstantCase:
    """Draw one history of a law.

    The threshold is the lowest value that another history of the law reaches after the first
    instant, relative to where that stood then: what happens says nothing of it.
    """
    rng = np.random.default_rng([seed, zlib.crc32(law.encode()), number])
    sd, length = NOISES[number % 3], LENGTHS[number // 3 % 3]
    while True:
        fine, truth, u, jumps = _path(law, length, rng)
        _, other, _, _ = _path(law, length, rng)
        later = fine >= INSTANTS[0]
        here, there = truth[later.argmax()], other[later.argmax()]
        threshold = here + float(other[later].min() - there)
        if LEAST < threshold < truth[~later].min() - 1e-3 and threshold < here - 1e-3:
            break
    time = np.arange(length + 1) / length
    value = np.interp(time, fine, truth) + sd * rng.standard_normal(length + 1)
    unit = float(np.exp(rng.uniform(np.log(50.0), np.log(5000.0))))
    return InstantCase(law, number, time, value, sd, fine, truth, threshold, unit, u, jumps)


def _path(
    law: str, length: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray, JumpTruth | None]:
    """Draw the truth on a fine grid: times, values, and what was drawn for it."""
    if law in CURVES:
        kind = CURVES[law]
        u = rng.standard_normal(kind.parameters)
        fine = np.arange(CURVE_FINE + 1) / CURVE_FINE
        return fine, kind.curve(u[None], fine)[0], u, None
    fine = np.arange(FINE * length + 1) / (FINE * length)
    step = fine[1]
    u = rng.standard_normal(4)
    start = 0.01 * u[0]
    if law == JUMPS:
        law_of = JumpTruth(
            float(between(u[1], 2.0, 8.0)), -float(between(u[2], 0.02, 0.08)), 0.02
        )
        count = rng.poisson(law_of.rate * step, len(fine) - 1)
        size = count * law_of.mean + np.sqrt(count) * law_of.sd * rng.standard_normal(
            len(count)
        )
        drift = -0.05 * abs(u[3]) * fine
        return fine, start + drift + np.concatenate([[0.0], np.cumsum(size)]), u, law_of
    sd, memory, slope = walk_of(law, u)
    shocks = rng.standard_normal(len(fine) - 1)
    if law == "random walk":
        wander = np.concatenate([[0.0], sd * np.sqrt(step) * np.cumsum(shocks)])
    else:
        keep, wander = np.exp(-step / memory), np.empty(len(fine))
        wander[0] = sd * rng.standard_normal()
        for i, shock in enumerate(sd * np.sqrt(1.0 - keep**2) * shocks):
            wander[i + 1] = keep * wander[i] + shock
    return fine, start + slope * fine + wander, u, None


def walk_of(law: str, u: np.ndarray) -> tuple[float, float, float]:
    """Scatter, memory (infinite of a random walk) and slope of a walk."""
    if law == "random walk":
        return float(between_logs(u[1], 0.05, 0.25)), np.inf, -0.1 + 0.1 * float(u[3])
    memory = float(between_logs(u[2], 0.02, 0.2))
    return float(between_logs(u[1], 0.02, 0.08)), memory, -0.1 + 0.1 * float(u[3])

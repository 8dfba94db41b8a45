"""Excitations known at every instant: cubic splines through band-limited signals.

What the integrators see between samples is the spline itself, so that no error is made there.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

Array = NDArray[np.float64]
POINTS_PER_PERIOD = 24
"""Knots in the shortest period of a signal."""


@dataclasses.dataclass(frozen=True, eq=False)
class Signal:
    """A piecewise cubic on knots `rate_hz` times a second, from time 0."""

    coefficients: Array
    """Of powers 3, 2, 1, 0 of the part of a knot's interval that has passed; [knot, power]."""
    rate_hz: float

    @classmethod
    def through(cls, values: Array, rate_hz: float) -> "Signal":
        powers = CubicSpline(np.arange(len(values)), values).c.T
        return cls(np.ascontiguousarray(powers), rate_hz)

    def at(self, times: Array) -> Array:
        place = times * self.rate_hz
        knot = np.clip(place.astype(int), 0, len(self.coefficients) - 1)
        s = place - knot
        c3, c2, c1, c0 = self.coefficients[knot].T
        return np.asarray(((c3 * s + c2) * s + c1) * s + c0)

    def times(self, factor: float) -> "Signal":
        return Signal(self.coefficients * factor, self.rate_hz)


def knot_rate(rate_hz: float, highest_hz: float) -> float:
    """Rate of knots: the least multiple of the sampling rate that is dense enough."""
    return rate_hz * math.ceil(POINTS_PER_PERIOD * highest_hz / rate_hz)


def excitation(
    kind: str,
    band_hz: tuple[float, float],
    seconds: float,
    rate_hz: float,
    rng: np.random.Generator,
) -> Array:
    """Values at the knots, of unit root mean square, by the name of their kind.

    Of a free decay, a single blow, twenty times that high, as short as the upper end of the
    band asks; of a release, nothing.
    """
    count = math.ceil(seconds * rate_hz) + 1
    if kind == "free_decay":
        return _blow(band_hz, count, rate_hz)
    if kind == "release":
        return np.zeros(count)
    makers = {
        "random": _random, "multisine": _multisine, "sweep": _sweep, "sine": _sine,
        "stepped_sine": _stepped_sine, "hammer": _hammer,
    }  # fmt: skip
    values = makers[kind](band_hz, count, rate_hz, rng)
    return np.asarray(values / np.sqrt(np.mean(values**2)))


def _random(
    band_hz: tuple[float, float], count: int, rate_hz: float, rng: np.random.Generator
) -> Array:
    lines = np.fft.rfftfreq(count, 1.0 / rate_hz)
    inside = (lines >= band_hz[0]) & (lines <= band_hz[1])
    spectrum = np.zeros(len(lines), complex)
    spectrum[inside] = rng.standard_normal((inside.sum(), 2)) @ [1.0, 1.0j]
    return np.asarray(np.fft.irfft(spectrum, count))


def _multisine(
    band_hz: tuple[float, float], count: int, rate_hz: float, rng: np.random.Generator
) -> Array:
    """Sines of equal amplitude and random phase; in half the cases only odd lines."""
    period = float(rng.choice([5.0, 8.0, 10.0]))
    lines = np.arange(math.ceil(band_hz[0] * period), math.floor(band_hz[1] * period) + 1)
    if rng.random() < 0.5 and (lines % 2 == 1).sum() > 4:
        lines = lines[lines % 2 == 1]
    around = round(period * rate_hz)
    spectrum = np.zeros(around // 2 + 1, complex)
    spectrum[lines] = np.exp(1j * rng.uniform(0, 2 * np.pi, len(lines)))
    return np.resize(np.fft.irfft(spectrum, around), count)


def _sweep(
    band_hz: tuple[float, float], count: int, rate_hz: float, rng: np.random.Generator
) -> Array:
    """From one end of the band to the other, its first and last twentieth faded."""
    low, high = band_hz if rng.random() < 0.5 else band_hz[::-1]
    times = np.arange(count) / rate_hz
    part = times / times[-1]
    if rng.random() < 0.5:
        turns = times * (low + (high - low) * part / 2)
    else:
        ratio = math.log(high / low)
        turns = low * times[-1] / ratio * np.expm1(ratio * part)
    fade = np.clip(np.minimum(part, 1 - part) * 20, 0, 1)
    return np.asarray(np.sin(2 * np.pi * turns) * np.sin(np.pi / 2 * fade) ** 2)


def _sine(
    band_hz: tuple[float, float], count: int, rate_hz: float, rng: np.random.Generator
) -> Array:
    times = np.arange(count) / rate_hz
    return np.asarray(np.sin(2 * np.pi * np.mean(band_hz) * times + rng.uniform(0, 2 * np.pi)))


def _stepped_sine(
    band_hz: tuple[float, float], count: int, rate_hz: float, rng: np.random.Generator
) -> Array:
    """Sines of equal amplitude, one frequency after the other, without a jump of phase."""
    steps = int(rng.integers(8, 15))
    frequencies = np.linspace(*band_hz, steps)
    if rng.random() < 0.5:
        frequencies = frequencies[::-1]
    step = np.minimum(np.arange(count) * steps // count, steps - 1)
    return np.asarray(np.sin(2 * np.pi * np.cumsum(frequencies[step]) / rate_hz))


def _hammer(
    band_hz: tuple[float, float], count: int, rate_hz: float, rng: np.random.Generator
) -> Array:
    """Blows of unequal strength, 2 to 4 s apart, as short as the upper end of the band asks."""
    values, blow = np.zeros(count), _blow(band_hz, math.ceil(rate_hz / band_hz[1]), rate_hz)
    first = int(rng.uniform(0.2, 0.6) * rate_hz)
    while first + len(blow) < count:
        values[first : first + len(blow)] = rng.uniform(0.6, 1.4) * blow
        first += int(rng.uniform(2.0, 4.0) * rate_hz)
    return values


def _blow(band_hz: tuple[float, float], count: int, rate_hz: float) -> Array:
    length = math.ceil(rate_hz / band_hz[1])
    values = np.zeros(count)
    values[:length] = 20.0 * np.sin(np.pi * np.arange(length) / length) ** 2
    return values

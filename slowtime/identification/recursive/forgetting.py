r"""Spectral matrices of a band under exponential forgetting.

Fourier coefficients of all that has been, fading with age,

.. math:: X_k(t) = \sum_j y(t_j) \, e^{(-a + i \omega_k)(t - t_j)} ,

need no more than their last values to go on, and the mean of :math:`X X^H` is the density of
correlations that fade as :math:`e^{-a |\tau|}`: a pole s of the structure stands at s - a,
exactly, and nothing is smeared in any other way.
"""

import dataclasses
import functools

import numpy as np
import scipy.fft as fft
from jaxtyping import Complex, Float

from .frames import BinRange
from .window_data import FadingSpectra

RESOLVED = 1e-3
"""Damping ratio that the window adds to every mode, and takes away again: a, over the middle
of the band [1]."""

SPACING = 1.25
"""Spacing of the ordinates, in units of a."""

WARM = 1.5
"""Time after a gap before coefficients count, in units of 1 / a."""

SEEN = 0.95
"""Least gain of the band at an ordinate that is used [1]."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FadingCoefficients:
    """What is kept: coefficients, sums of their products, and how much went into these.

    Products are those of each channel with each direction, and with itself (`powers`).
    `weight` and `squares` are sums over frames of the weights and of their squares.
    """

    coefficients: Complex[np.ndarray, "ordinate channel"]
    products: Complex[np.ndarray, "ordinate channel direction"]
    powers: Float[np.ndarray, "ordinate channel"]
    weight: float = 0.0
    squares: float = 0.0
    warm_s: float = 0.0


@dataclasses.dataclass(frozen=True, slots=True)
class FrequencyGrid:
    """Ordinates of one band, and how they are stepped by one frame."""

    frame: BinRange

    @property
    def decay(self) -> float:
        """How fast the window fades, a [rad/s]."""
        band = self.frame.band
        return RESOLVED * np.pi * (band.low_hz + band.high_hz)

    @property
    def spacing_hz(self) -> float:
        """Between ordinates [Hz]."""
        return self.frame.rate_hz / _table(self).size

    @property
    def frequency_hz(self) -> Float[np.ndarray, " ordinate"]:
        """Of the ordinates, ascending [Hz]."""
        return _table(self).frequency_hz

    def start(self, channels: int, directions: int) -> FadingCoefficients:
        """Start without data."""
        shape = (len(self.frequency_hz), channels)
        products = np.zeros((*shape, directions), complex)
        return FadingCoefficients(np.zeros(shape, complex), products, np.zeros(shape))

    def after_gap(self, fading: FadingCoefficients) -> FadingCoefficients:
        """State after a gap: coefficients restart, sums remain."""
        rest = np.zeros_like(fading.coefficients)
        return dataclasses.replace(fading, coefficients=rest, warm_s=0.0)

    def step(
        self,
        fading: FadingCoefficients,
        slow: Complex[np.ndarray, "instant channel"],
        into: Complex[np.ndarray, "channel direction"],
        memory_s: float | None,
    ) -> FadingCoefficients:
        """Process the instants of one frame.

        With `memory_s` None, everything is kept.
        """
        table, count = _table(self), len(slow)
        passed = count / self.frame.rate_hz
        faded = slow * np.exp(-self.decay / self.frame.rate_hz * np.arange(count)[::-1, None])
        fresh = fft.fft(faded, n=table.size, axis=0)[table.index]
        turn = np.exp(1j * table.angle * (count - 1))
        on = np.exp(-self.decay * passed) * turn * np.exp(1j * table.angle)
        coefficients = on[:, None] * fading.coefficients + turn[:, None] * fresh
        warm_s = fading.warm_s + passed
        if warm_s * self.decay < WARM:
            return dataclasses.replace(fading, coefficients=coefficients, warm_s=warm_s)
        kept = 1.0 if memory_s is None else float(np.exp(-passed / memory_s))
        outer = coefficients[:, :, None] * (coefficients @ into).conj()[:, None, :]
        return FadingCoefficients(
            coefficients,
            kept * fading.products + passed * outer,
            kept * fading.powers + passed * np.abs(coefficients) ** 2,
            kept * fading.weight + passed,
            kept**2 * fading.squares + passed**2,
            warm_s,
        )

    def seen(
        self, fading: FadingCoefficients, into: Complex[np.ndarray, "channel direction"]
    ) -> FadingSpectra:
        """Mean spectral matrices, up to a factor."""
        seconds = self.frame.hop_s * fading.weight**2 / fading.squares
        gain = fading.weight * self.frame.band.gain(self.frequency_hz) ** 2
        cross = fading.products / gain[:, None, None]
        return FadingSpectra(
            frequency_hz=self.frequency_hz,
            density=into.T @ cross,
            cross=cross,
            power=fading.powers / gain[:, None],
            number=seconds * self.spacing_hz,
            decay=self.decay,
            spared=np.zeros(len(cross), dtype=bool),
        )


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Table:
    size: int
    index: np.ndarray
    angle: np.ndarray
    frequency_hz: np.ndarray


@functools.lru_cache(maxsize=256)
def _table(raster: FrequencyGrid) -> _Table:
    frame = raster.frame
    least = frame.rate_hz * 2 * np.pi / (SPACING * raster.decay)
    size = fft.next_fast_len(int(np.ceil(least)))
    offset = fft.fftfreq(size, 1.0 / frame.rate_hz)
    index = np.argsort(offset)
    index = index[frame.band.gain(frame.centre_hz + offset[index]) > SEEN]
    angle = 2 * np.pi * offset[index] / frame.rate_hz
    return _Table(size, index, angle, frame.centre_hz + offset[index])

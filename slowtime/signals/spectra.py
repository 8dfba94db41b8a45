"""One-sided power spectral densities, smoothing and noise floors."""

import dataclasses
import functools

import numpy as np
import scipy.fft as fft
from jaxtyping import Complex, Float
from scipy.ndimage import percentile_filter
from scipy.special import gammaincinv

from .finite_filters import taper as _taper

FLOOR_QUANTILE = 40.0
"""The floor is this percentile of its neighbourhood: below the median, for peaks weigh less."""

MOST_AVERAGED = 300
"""Beyond so many ordinates percentile and mean are the same for the purpose."""


LONG = 262_144
"""Samples from which on memory is spared, by sums in another order."""

PIECE = 65_536
"""Rows that are worked at once, where what is worked needs room of its own."""


@dataclasses.dataclass(frozen=True, slots=True)
class DensitySpectrum:
    r"""One-sided power spectral densities of all channels.

    Parameters
    ----------
    frequency_hz
        Equally spaced, from 0 [Hz].
    density
        :math:`S(f)` per channel [unit²/Hz]; its sum times the spacing is the variance.
    """

    frequency_hz: Float[np.ndarray, " frequency"]
    density: Float[np.ndarray, "frequency channel"]

    @property
    def spacing_hz(self) -> float:
        """Distance between neighbouring frequencies [Hz]."""
        return float(self.frequency_hz[1])


def detrended(samples: Float[np.ndarray, "time channel"]) -> Float[np.ndarray, "time channel"]:
    """Subtract the least-squares straight line of each channel.

    Parameters
    ----------
    samples
        Samples, channels in columns.

    Returns
    -------
    Samples without trend.

    Examples
    --------
    >>> line = 3.0 + 2.0 * np.arange(5.0)[:, None]
    >>> bool(np.allclose(detrended(line), 0.0))
    True
    """
    instants = np.arange(len(samples)) - (len(samples) - 1) / 2
    slope = instants @ samples / (instants @ instants)
    left = np.asarray(samples - samples.mean(axis=0))
    # In pieces: a long record leaves no room for its straight line.
    for first in range(0, len(left), PIECE):
        piece = slice(first, first + PIECE)
        left[piece] -= instants[piece, None] * slope
    return left


def transform(
    samples: Float[np.ndarray, "time channel"], rate_hz: float, *, taper: str = "boxcar"
) -> tuple[Float[np.ndarray, " frequency"], Complex[np.ndarray, "frequency channel"]]:
    r"""Fourier coefficients scaled so that their squared moduli are one-sided densities.

    .. math:: Y_k = \sqrt{\frac{2\,\Delta t}{\sum_n h_n^2}}
              \sum_n h_n \, y_n \, e^{-2 \pi i k n / N}

    Parameters
    ----------
    samples
        One column per channel, detrended by the caller if need be.
    taper
        ``boxcar`` or ``hann``: the window :math:`h_n`.

    Returns
    -------
    Frequencies [Hz], and coefficients.
    """
    count = len(samples)
    tapered, power = _tapered(samples, taper)
    scale = np.sqrt(2.0 / (rate_hz * power))
    coefficients = fft.rfft(tapered, axis=0)
    del tapered
    coefficients *= scale
    coefficients[0] /= np.sqrt(2.0)
    if count % 2 == 0:
        coefficients[-1] /= np.sqrt(2.0)
    return fft.rfftfreq(count, 1.0 / rate_hz), coefficients


def _tapered(
    samples: np.ndarray, taper: str, first: int = 0, step: int = 1
) -> tuple[np.ndarray, float]:
    """Every `step`-th sample from the `first` on times a window, and the sum of its squares."""
    count, chosen = len(samples), samples[first::step]
    if taper == "boxcar":
        return chosen, float(len(chosen))
    if taper != "hann" or count <= LONG:
        window = _taper(taper, count)[first::step]
        return chosen * window[:, None], float(window @ window)
    tapered, power = np.empty(chosen.shape), 0.0
    for begin in range(0, len(chosen), PIECE):
        place = np.arange(begin, min(begin + PIECE, len(chosen)))
        window = 0.5 - 0.5 * np.cos(2 * np.pi / count * (first + step * place))
        tapered[place] = chosen[place] * window[:, None]
        power += float(window @ window)
    return tapered, power


def periodogram(
    samples: Float[np.ndarray, "time channel"], rate_hz: float, *, taper: str = "boxcar"
) -> DensitySpectrum:
    """One-sided periodogram of a whole record.

    Parameters
    ----------
    samples
        Samples, channels in columns.
    taper
        Window.

    Returns
    -------
    Density [unit^2/Hz] of each channel.

    Examples
    --------
    >>> noise = np.random.default_rng(1).standard_normal((4096, 1))
    >>> spectrum = periodogram(noise, 100.0)
    >>> power = spectrum.density.sum() * spectrum.spacing_hz
    >>> bool(np.isclose(power, np.mean(noise**2)))
    True
    """
    count = len(samples)
    if count > LONG and count % 2 == 0:
        density = _density_by_halves(samples, rate_hz, taper)
        return DensitySpectrum(fft.rfftfreq(count, 1.0 / rate_hz), density)
    frequency, coefficients = transform(samples, rate_hz, taper=taper)
    return DensitySpectrum(frequency, np.abs(coefficients) ** 2)


def _density_by_halves(samples: np.ndarray, rate_hz: float, taper: str) -> np.ndarray:
    r"""Periodogram by the transforms E and O of the samples of even and of odd number.

    .. math:: Y_k = E_k + e^{-2 \pi i k / N} O_k, \qquad
              Y_{N/2-k}^* = E_k - e^{-2 \pi i k / N} O_k

    The transform of a long record takes six times its memory; this one takes half of that.
    """
    count, power = len(samples), 0.0
    parts = []
    for first in (0, 1):
        tapered, own = _tapered(samples, taper, first, 2)
        parts.append(fft.rfft(tapered, axis=0))
        power += own
        del tapered
    even, odd = parts
    density = np.empty((count // 2 + 1, samples.shape[1]))
    for first in range(0, len(even), PIECE):
        k = np.arange(first, min(first + PIECE, len(even)))
        turned = np.exp(-2j * np.pi / count * k)[:, None] * odd[k]
        density[k] = np.abs(even[k] + turned) ** 2
        density[count // 2 - k] = np.abs(even[k] - turned) ** 2
    density *= 2.0 / (rate_hz * power)
    density[[0, -1]] /= 2.0
    return density


def welch(
    samples: Float[np.ndarray, "time channel"], rate_hz: float, *, segment_s: float
) -> DensitySpectrum:
    """One-sided density by Welch's method: half-overlapping Hann segments.

    Parameters
    ----------
    samples
        Samples, channels in columns.
    segment_s
        Length of a segment [s].

    Returns
    -------
    Density [unit^2/Hz] of each channel.
    """
    length = round(segment_s * rate_hz)
    if not 8 <= length <= len(samples):
        raise ValueError(
            f"segment_s={segment_s} is {length} samples of a record of {len(samples)}. "
            f"Give a segment from {8 / rate_hz:g} s to {len(samples) / rate_hz:g} s."
        )
    starts = range(0, len(samples) - length + 1, length - length // 2)
    segments = (detrended(samples[start : start + length]) for start in starts)
    spectra = [periodogram(segment, rate_hz, taper="hann") for segment in segments]
    total = functools.reduce(np.add, (spectrum.density for spectrum in spectra))
    return DensitySpectrum(spectra[0].frequency_hz, np.asarray(total / len(spectra)))


def smoothed(
    density: Float[np.ndarray, "frequency channel"], relative_half_width: float
) -> tuple[Float[np.ndarray, "frequency channel"], Float[np.ndarray, " frequency"]]:
    r"""Average over :math:`f (1 \pm \beta)`.

    A resonance is as wide as its frequency times its damping, so a width proportional to
    frequency smooths low and high modes alike; where it is under one bin nothing changes.

    Parameters
    ----------
    density
        Density of each channel.
    relative_half_width
        :math:`\beta` [1].

    Returns
    -------
    Averages, and the number of ordinates in each.
    """
    count = len(density)
    running = np.zeros((count + 1, density.shape[1]))
    np.cumsum(density, axis=0, out=running[1:])
    means, number = np.empty(density.shape), np.empty(count)
    for first in range(0, count, PIECE):
        index = np.arange(first, min(first + PIECE, count))
        reach = np.floor(index * relative_half_width).astype(int)
        low = np.maximum(index - reach, 0)
        high = np.minimum(index + reach + 1, count)
        number[index] = high - low
        means[index] = (running[high] - running[low]) / number[index, None]
    return means, number


def noise_floor(
    density: Float[np.ndarray, "frequency channel"], *, octaves: float = 1.0, points: int = 256
) -> Float[np.ndarray, "frequency channel"]:
    """Noise floor: a low percentile of the neighbourhood, corrected to the mean.

    A running percentile over `octaves` on either side, on a logarithmic frequency axis of
    `points` points, scaled to the mean that exponentially scattered ordinates with that
    percentile would have. It follows drift and coloured noise, and ignores peaks that fill
    less than half of the neighbourhood.

    Parameters
    ----------
    density
        Density of each channel.
    octaves
        Half-width of the neighbourhood [octaves].
    points
        Number of points of the logarithmic frequency axis.

    Returns
    -------
    Floor of each channel.
    """
    count = len(density)
    edges = np.unique(np.geomspace(1, count, points + 1).round().astype(int))
    width = np.diff(edges)
    means = np.add.reduceat(density[: edges[-1]], edges[:-1], axis=0) / width[:, None]
    logarithms = np.log(np.maximum(means, np.finfo(float).tiny))
    centres = np.log(0.5 * (edges[:-1] + edges[1:] - 1))
    ruler = np.linspace(centres[0], centres[-1], points)
    columns = [np.interp(ruler, centres, column) for column in logarithms.T]
    size = max(3, 2 * round(octaves * np.log(2.0) / (ruler[1] - ruler[0])) + 1)
    floors = [percentile_filter(c, FLOOR_QUANTILE, size=size, mode="reflect") for c in columns]
    averaged = np.minimum(width, MOST_AVERAGED).astype(float)
    found = np.empty(density.shape)
    for first in range(0, count, PIECE):
        index = np.arange(first, min(first + PIECE, count))
        where = np.log(np.maximum(index, 1))
        mean = _percentile_to_mean(np.interp(where, centres, averaged))
        for column, floor in enumerate(floors):
            found[index, column] = np.exp(np.interp(where, ruler, floor)) * mean
    return found


def _percentile_to_mean(ordinates: Float[np.ndarray, " frequency"]) -> np.ndarray:
    """Ratio of mean to percentile of a mean of that many exponential ordinates (gamma law)."""
    known = np.arange(1.0, MOST_AVERAGED + 1.0)
    ratio = known / gammaincinv(known, FLOOR_QUANTILE / 100.0)
    return np.asarray(np.interp(ordinates, known, ratio))

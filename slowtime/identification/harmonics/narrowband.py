r"""Statistics of narrow frequency bands: steadiness, and share of a single tone.

Two statistics of the complex envelope z tell a machine from a mode:

.. math:: \rho = \frac{\overline{|z|^4}}{\overline{|z|^2}^2}, \qquad
          r = 1 - \max_\delta \frac{|\overline{z e^{-i \delta t}}|^2}{\overline{|z|^2}} ,

the first 1 for anything of constant amplitude and 2 for a Gaussian process (the band-passed
signal has the kurtosis 3/2 of that: 1.5 and 3), the second 0 for a tone that stays put, and
near 1 for noise. A mode under random force is a Gaussian process; seen for less than its memory
it too looks like a tone. How often, `draw_envelopes` tells by drawing such modes.
"""

import dataclasses

import numpy as np
import scipy.fft as fft
from jaxtyping import Complex, Float

from slowtime.signals.recursive_filters import first_order
from slowtime.signals.spectra import transform

PADDING = 8
"""Zero-padding factor of the search for the best tone."""

OVERSAMPLED = 4
"""Oversampling factor of the drawn modes before they are cut to the band."""

RIDGE = 0.1
"""Share of a channel's noise that is assumed independent of the other channels [1]."""


@dataclasses.dataclass(frozen=True, slots=True)
class FourierSpectra:
    """Fourier coefficients of all channels; |coefficient|² is a one-sided density."""

    coefficients: Complex[np.ndarray, "frequency channel"]
    spacing_hz: float


def fourier_spectra(
    samples: Float[np.ndarray, "time channel"], rate_hz: float
) -> FourierSpectra:
    """Fourier coefficients of a whole record, without a taper."""
    frequency, coefficients = transform(samples, rate_hz)
    return FourierSpectra(coefficients, float(frequency[1]))


@dataclasses.dataclass(frozen=True, slots=True)
class NarrowBand:
    """Complex envelope of a band, scaled to unit noise density.

    `snr` is the power in the band over that of the noise in it.
    """

    envelope: Complex[np.ndarray, " instant"]
    snr: float
    centre: int


def narrow_band(spectra: FourierSpectra, centre: int, half_width: int) -> NarrowBand:
    r"""Envelope of a band in the channel combination with the best signal-to-noise ratio.

    The direction maximises :math:`w^H S_p w / w^H S_n w`, with the spectral matrices of the
    peak's bins and of its surroundings.
    """
    last = len(spectra.coefficients) - 1
    half_width = max(1, min(half_width, centre - 1, last - centre))
    inside = spectra.coefficients[centre - half_width : centre + half_width + 1]
    noise = _surroundings(spectra.coefficients, centre, half_width)
    own = np.diag(np.diag(noise).real)
    noise = (1 - RIDGE) * noise + RIDGE * own
    peak = inside[max(0, half_width - 1) : half_width + 2]
    signal = peak.T @ peak.conj() / len(peak)
    noise = noise + np.eye(len(noise)) * 1e-12 * np.trace(signal).real
    root = np.linalg.cholesky(noise)
    whitened = np.linalg.solve(root, inside.T)
    at_peak = whitened[:, max(0, half_width - 1) : half_width + 2]
    direction = np.linalg.svd(at_peak, full_matrices=False)[0][:, 0]
    bins = direction.conj() @ whitened
    envelope = fft.ifft(fft.ifftshift(bins)) * len(bins)
    snr = max(float(np.mean(np.abs(bins) ** 2)) - 1.0, 0.0)
    return NarrowBand(np.asarray(envelope), snr, centre)


def steadiness(
    envelopes: Complex[np.ndarray, "*draw instant"],
) -> Float[np.ndarray, "*draw"]:
    r"""Fourth moment of the envelope over its squared second moment, row by row.

    It is 1 for constant amplitude, and 2 for a Gaussian process.

    Examples
    --------
    >>> steadiness(np.exp(1j * np.arange(8.0))[None]).round(9)
    array([1.])
    """
    power = np.abs(envelopes) ** 2
    mean = np.maximum(power.mean(axis=-1), np.finfo(float).tiny)
    return np.asarray((power**2).mean(axis=-1) / mean**2)


def residual_share(
    envelopes: Complex[np.ndarray, "*draw instant"],
) -> Float[np.ndarray, "*draw"]:
    """Share of the power that the best single tone leaves, 0 to 1, row by row.

    Examples
    --------
    >>> residual_share(np.exp(0.25j * np.pi * np.arange(64.0))[None]).round(2) + 0
    array([0.])
    """
    count = envelopes.shape[-1]
    lines = np.abs(fft.fft(envelopes, PADDING * count, axis=-1)) ** 2
    power = np.maximum(np.sum(np.abs(envelopes) ** 2, axis=-1), np.finfo(float).tiny)
    return np.asarray(1.0 - lines.max(axis=-1) / (count * power))


def draw_envelopes(
    half_widths_in_record: float,
    snr: float,
    bins: int,
    draws: int,
    rng: np.random.Generator,
) -> Complex[np.ndarray, "draw instant"]:
    r"""Draw envelopes of a mode under random force, cut to a band of `bins` like the record's.

    `snr` is the power of the mode over the noise, both within the band.
    """
    count = OVERSAMPLED * bins
    # The envelope of a lightly damped mode is a complex Ornstein-Uhlenbeck process whose decay
    # over the record is 2 pi times the mode's half-bandwidth, counted in bins.
    keep = np.exp(-2 * np.pi * half_widths_in_record / count)
    # Single precision is ample for what is drawn, and twice as fast.
    shocks = rng.standard_normal((draws, 2 * count), dtype=np.float32).view(np.complex64)
    shocks[:, 1:] *= np.float32(np.sqrt(1 - keep**2))
    # Off the raster of the record by a random part of a bin, as any mode is.
    off = 2j * np.pi * rng.uniform(-0.5, 0.5, (draws, 1)) / count
    turn = np.exp(off * np.arange(count)).astype(np.complex64)
    process = turn * first_order(shocks, float(keep))
    spectrum = fft.fft(process, axis=-1) / count
    half = bins // 2
    cut = np.concatenate([spectrum[:, : half + 1], spectrum[:, -half:]], axis=-1)
    noise = rng.standard_normal((2, draws, bins))
    power = np.mean(np.sum(np.abs(cut) ** 2, axis=-1))
    level = np.sqrt(power / (2 * bins * max(snr, 1e-12)))
    cut = cut + level * (noise[0] + 1j * noise[1])
    return np.asarray(fft.ifft(cut, axis=-1) * bins)


def _surroundings(coefficients: np.ndarray, centre: int, half_width: int) -> np.ndarray:
    """Spectral matrix of the noise, told from the quieter half of the bins beside the band."""
    reach = half_width + max(2 * half_width, 4 * coefficients.shape[1])
    low, high = max(1, centre - reach), min(len(coefficients), centre + reach + 1)
    index = np.arange(low, high)
    beside = coefficients[index[np.abs(index - centre) > half_width]]
    if len(beside) < 2:
        beside = coefficients[1:]
    level = np.median(np.abs(beside) ** 2, axis=0) + np.finfo(float).tiny
    loudness = np.mean(np.abs(beside) ** 2 / level, axis=1)
    quiet = beside[loudness <= np.median(loudness)]
    matrix = quiet.T @ quiet.conj() / len(quiet)
    # Median of |.|² of complex Gaussians is ln 2 of its mean; the quieter half has less power.
    scale = np.sqrt(level / np.log(2.0) / np.maximum(np.diag(matrix).real, 1e-300))
    return np.asarray(scale[:, None] * matrix * scale)

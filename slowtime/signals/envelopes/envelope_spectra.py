"""Spectrum of the squared envelope of a band, and how surely a family of lines is in it."""

from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Complex, Float

BANDS_PER_OCTAVE_OF_WIDTH = 2
"""[1] Bands of one width overlap by half, so that a resonance lies whole in one of them."""

WIDEST_SHARE = 0.5
"""[1] Widest band that is tried, as a share of half of the sampling rate."""

LEAST_LINES = 64
"""[1] Independent samples of an envelope, below which its kurtosis is not compared: its
standard deviation sqrt(24 / 64) is then 0.6 for Gaussian noise."""

FLOOR_LINES = 201
"""[lines] Width of the running median that tells the noise between the lines."""


class Band(NamedTuple):
    """Lower and upper edge of a band [Hz]."""

    low: float
    high: float


class EnvelopeSpectrum(NamedTuple):
    """Periodogram of a squared envelope over the noise between its lines.

    Parameters
    ----------
    frequency_hz
        Of each line [Hz], from the first above zero; their distance is one over the duration.
    amplitude
        Of the squared envelope relative to its mean [1]: how deeply it is modulated.
    over_noise
        Power of a line relative to its expectation without periodic impacts [1]; it is then
        distributed exponentially, with mean 1.
    """

    frequency_hz: Float[np.ndarray, " line"]
    amplitude: Float[np.ndarray, " line"]
    over_noise: Float[np.ndarray, " line"]


class Family(NamedTuple):
    """A frequency and its multiples in the spectrum of an envelope.

    Parameters
    ----------
    p_value
        Probability of so strong a weakest line, if at least one of them is noise [1].
    frequency_hz, sd_hz
        Found frequency and its standard deviation [Hz].
    over_noise
        Power of the frequency and of each multiple, relative to the noise [1].
    """

    p_value: float
    frequency_hz: float
    sd_hz: float
    over_noise: Float[np.ndarray, " multiple"]


def complex_envelope(
    samples: Float[np.ndarray, " time"], rate_hz: float, band: Band
) -> Complex[np.ndarray, " slow"]:
    """Shift a band to zero frequency and keep only as many samples as it needs.

    The modulus is the envelope; the rate of the samples is the width of the band.
    """
    spectrum = scipy.fft.rfft(samples - samples.mean())
    per_hz = len(samples) / rate_hz
    first, last = round(band.low * per_hz), round(band.high * per_hz)
    within = spectrum[first:last] * scipy.signal.windows.tukey(last - first, 0.2)
    return np.asarray(scipy.fft.ifft(within)) * 2 * len(within) / len(samples)


def most_impulsive_band(
    samples: Float[np.ndarray, " time"], rate_hz: float, above_hz: float
) -> Band:
    """Find the band whose envelope has the highest kurtosis, of bands that overlap by half.

    Parameters
    ----------
    above_hz
        Narrowest width, and lowest edge, of the bands [Hz]: several times the frequency of the
        impacts, lest their lines do not fit into the spectrum of the envelope.

    References
    ----------
    J. Antoni, "Fast computation of the kurtogram for the detection of transient faults",
    Mechanical Systems and Signal Processing 21 (2007) 108-124.
    """
    half, width = rate_hz / 2, WIDEST_SHARE * rate_hz / 2
    seconds = len(samples) / rate_hz
    best, found = -np.inf, Band(above_hz, half)
    while width >= above_hz and width * seconds >= LEAST_LINES:
        lows = np.arange(above_hz, half - width, width / BANDS_PER_OCTAVE_OF_WIDTH)
        for low in lows:
            band = Band(float(low), float(low + width))
            kurtosis = _kurtosis(complex_envelope(samples, rate_hz, band))
            if kurtosis > best:
                best, found = kurtosis, band
        width /= 2
    return found


def envelope_spectrum(
    samples: Float[np.ndarray, " time"], rate_hz: float, band: Band
) -> EnvelopeSpectrum:
    """Compute the spectrum of the squared envelope of a band, up to half of its width."""
    power = np.abs(complex_envelope(samples, rate_hz, band)) ** 2
    relative = power / power.mean() - 1.0
    spectrum = np.abs(scipy.fft.rfft(relative))[1 : len(relative) // 2]
    noise = scipy.ndimage.median_filter(spectrum**2, FLOOR_LINES, mode="reflect") / np.log(2)
    frequency = np.arange(1, len(spectrum) + 1) * rate_hz / len(samples)
    return EnvelopeSpectrum(frequency, 2 * spectrum / len(relative), spectrum**2 / noise)


def family(
    spectrum: EnvelopeSpectrum, expected_hz: float, multiples: int, within: float
) -> Family:
    """Test whether a frequency is in the spectrum of an envelope with all of its multiples.

    One strong line shows nothing, as families share lines: twice one defect's frequency may be
    three times that of another. The weakest line decides, of the frequency near the expected
    one for which it is strongest; the test allows for all frequencies that were tried.

    Parameters
    ----------
    expected_hz
        Frequency to look for [Hz].
    multiples
        How many lines belong together, the frequency itself included.
    within
        Relative deviation that is looked through, for slip [1].

    Raises
    ------
    ValueError
        If a multiple lies beyond the spectrum.
    """
    step, number = float(spectrum.frequency_hz[0]), np.arange(1, multiples + 1)
    if multiples * expected_hz * (1 + within) > spectrum.frequency_hz[-1]:
        raise ValueError(
            f"{multiples} x {expected_hz:g} Hz lies beyond the spectrum of the envelope, which "
            f"goes to {spectrum.frequency_hz[-1]:g} Hz. Take a band that is wider than "
            f"{2 * multiples * expected_hz * (1 + within):g} Hz, or fewer multiples."
        )
    reach = max(within * expected_hz, step / multiples)
    tried = expected_hz + np.arange(-reach, reach, step / (2 * multiples))
    rows = np.rint(np.outer(tried, number) / step).astype(int) - 1
    lines = spectrum.over_noise[np.maximum(rows, 0)]
    best = int(lines.min(axis=1).argmax())
    looked_at = max(2 * reach * multiples / step, 1.0)
    # A line is told to a fraction of its distance from the next one (Rife and Boorstyn 1974);
    # lines of a grid add the error of rounding.
    sd = step / number * np.sqrt(6 / (2 * np.pi) ** 2 / lines[best] + 1 / 12)
    return Family(
        p_value=float(-np.expm1(looked_at * np.log1p(-np.exp(-lines[best].min())))),
        frequency_hz=float(tried[best]),
        sd_hz=float(sd[-1]),
        over_noise=lines[best],
    )


def _kurtosis(envelope: Complex[np.ndarray, " slow"]) -> float:
    """Kurtosis of a complex envelope [1]; 0 for Gaussian noise."""
    power = np.abs(envelope) ** 2
    return float((power**2).mean() / power.mean() ** 2 - 2.0)

"""Frequency, amplitude, shape and removal of spectral lines."""

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification.estimates import Measured
from slowtime.identification.mode_shapes.criteria import normalised

from .narrowband import FourierSpectra, NarrowBand

PADDING = 8
"""Places tried a bin, and again between two of them, `ZOOMS` times."""

ZOOMS = 4

STEADY_BINS = 1.0
"""A line spread over less than this is one tone."""

STRONG = 0.05
"""Bins of a line are those with so much of its strongest ordinate."""

SEARCH_BINS = 4
SEARCH_SHARE = 1e-3
"""A line is looked for so far from where it is said to be: in bins, and of its frequency."""

PIECE = 16_384
"""Rows from which lines are taken at once."""


def strongest_bin(spectra: FourierSpectra, frequency_hz: float) -> int:
    """Bin of the strongest ordinate about a frequency, channels weighted by their own level.

    Raises `ValueError` where the frequency is too close to zero or to half the sampling rate.
    """
    last = len(spectra.coefficients) - 2
    at = round(frequency_hz / spectra.spacing_hz)
    if not 2 <= at <= last - 1:
        raise ValueError(
            f"A peak at {frequency_hz:g} Hz was given. Allowed for this record are "
            f"{2 * spectra.spacing_hz:g} to {(last - 1) * spectra.spacing_hz:g} Hz; leave out "
            "the others."
        )
    reach = max(SEARCH_BINS, round(SEARCH_SHARE * at))
    low, high = max(2, at - reach), min(last, at + reach + 1)
    wide = np.abs(spectra.coefficients[max(1, low - 40) : high + 40]) ** 2
    level = np.median(wide, axis=0) + np.finfo(float).tiny
    ratio = (np.abs(spectra.coefficients[low:high]) ** 2 / level).sum(axis=1)
    return low + int(np.argmax(ratio))


def line_frequency(seen: NarrowBand, spacing_hz: float) -> Measured:
    r"""Frequency of a spectral line; its error is a tone's, or how far it wanders [Hz]."""
    count = len(seen.envelope)
    bins = np.fft.fft(seen.envelope) / count
    offset = np.fft.fftfreq(count, 1.0 / count)
    raster = np.linspace(-count / 2, count / 2, PADDING * count + 1)
    for _ in range(ZOOMS):
        place = float(raster[np.argmax(_matched(bins, offset, raster))])
        raster = place + (raster[1] - raster[0]) * np.linspace(-1.0, 1.0, 2 * PADDING + 1)
    # The coefficients of a tone at place p go as exp(i pi (p - k)) sinc(p - k) over the bins k;
    # the best p has the standard deviation sqrt(6 / E) / 2 pi bins, E its energy over the noise
    # density.
    tone = np.sqrt(6.0 / max(seen.snr * count, 1e-9)) / (2 * np.pi)
    strong = np.abs(bins) ** 2 > STRONG * np.max(np.abs(bins)) ** 2
    spread = np.average((offset[strong] - place) ** 2, weights=np.abs(bins[strong]) ** 2)
    wander = float(np.sqrt(spread))
    sd = min(tone if wander < STEADY_BINS else float(np.hypot(tone, wander)), count / 4.0)
    return Measured(float((seen.centre + place) * spacing_hz), float(sd * spacing_hz))


def _matched(bins: np.ndarray, offset: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Power of the bins that a tone at each place explains."""
    away = places[:, None] - offset
    kernel = np.exp(1j * np.pi * away) * np.sinc(away)
    return np.asarray(np.abs(kernel.conj() @ bins) ** 2 / np.sum(np.abs(kernel) ** 2, axis=1))


def line_amplitude(spectra: FourierSpectra, seen: NarrowBand) -> float:
    """Root mean square of a line, noise taken off, in the channel that moves most."""
    half = len(seen.envelope) // 2
    bins = spectra.coefficients[max(0, seen.centre - half) : seen.centre + half + 1]
    power = np.sum(np.abs(bins) ** 2, axis=0).max() * spectra.spacing_hz
    return float(np.sqrt(power * seen.snr / (1.0 + seen.snr)))


def line_shape(spectra: FourierSpectra, centre: int) -> Complex[np.ndarray, " channel"]:
    """Deflection of the channels at the peak, of unit norm."""
    bins = spectra.coefficients[centre - 1 : centre + 2]
    left = np.linalg.svd(bins.T, full_matrices=False)[0][:, 0]
    return normalised(left)


def remove_lines(
    samples: Float[np.ndarray, "time channel"],
    rate_hz: float,
    lines: tuple[Measured, ...],
) -> Float[np.ndarray, "time channel"]:
    r"""Remove lines from a record by least squares, each with the bins that it wanders over.

    A steady line takes its tone and one bin either side, for slow changes of its amplitude; one
    that wanders with standard deviation s takes :math:`\lceil 2 s T \rceil` bins. Unlike a band
    left out of the spectrum this takes the leakage of the line from everywhere else, too.

    Examples
    --------
    >>> seconds = np.arange(3000)[:, None] / 100.0
    >>> sine = np.sin(2 * np.pi * 12.345 * seconds)
    >>> left = remove_lines(sine, 100.0, (Measured(12.345, 0.0),))
    >>> bool(np.abs(left).max() < 1e-2)
    True
    """
    left = np.array(samples, dtype=float)
    count = len(left)
    cycles = np.unique([f for line in lines for f in _bins_of(line, rate_hz, count)])
    waves = np.concatenate([cycles, -cycles])  # cycles per sample
    # In pieces, each of them the first one turned: waves of a long record are larger than it.
    rows = min(PIECE, count)
    piece = np.exp(2j * np.pi * np.outer(np.arange(rows), cycles))
    turns = [(at, np.exp(2j * np.pi * cycles * at)[:, None]) for at in range(0, count, rows)]
    parts = np.zeros((len(cycles), left.shape[1]), dtype=complex)
    for at, turn in turns:
        here = left[at : at + rows]
        parts += turn.conj() * (piece[: len(here)].conj().T @ here)
    right = np.concatenate([parts, parts.conj()])
    amplitudes = np.linalg.lstsq(_overlap(waves, count), right, rcond=1e-9)[0][: len(cycles)]
    for at, turn in turns:
        here = left[at : at + rows]
        here -= 2.0 * (piece[: len(here)] @ (turn * amplitudes)).real
    return left


def _bins_of(line: Measured, rate_hz: float, count: int) -> np.ndarray:
    """Cycles per sample of a line and of the bins that it needs besides."""
    reach = max(1, int(np.ceil(2.0 * line.sd * count / rate_hz)))
    return np.asarray(line.value / rate_hz + np.arange(-reach, reach + 1) / count)


def _overlap(cycles: np.ndarray, count: int) -> np.ndarray:
    """Inner products of the waves, a geometric series in closed form."""
    apart = cycles - cycles[:, None]
    middle = np.exp(1j * np.pi * apart * (count - 1))
    whole = np.abs(apart - np.round(apart)) < 1e-14
    series = np.sin(np.pi * apart * count) / np.where(whole, 1.0, np.sin(np.pi * apart))
    return np.asarray(np.where(whole, count, series) * middle)

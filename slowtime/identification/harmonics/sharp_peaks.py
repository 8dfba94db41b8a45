"""Spectral peaks that stand out of their immediate surroundings."""

import bisect

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, uniform_filter1d
from scipy.special import gammainccinv

from slowtime.signals.spectra import PIECE

from .narrowband import FourierSpectra

FALSE_ALARM = 1e-2
"""Probability that smooth noise shows any peak."""

WIDTHS = (1, 7, 31)
"""Widths of the averages in which peaks are sought [bins]: steady lines, and lines that
wander."""

SURROUNDINGS = 20
"""Width of the median that is the reference level [widths of the average]."""

MOST = 100
"""Largest number of peaks."""


def sharp_peaks(spectra: FourierSpectra, low_hz: float, high_hz: float) -> list[float]:
    """Frequencies of peaks at most a few tens of bins wide, ascending [Hz]."""
    power = _hann_power(spectra.coefficients)
    index = np.arange(len(power))
    inside = (index * spectra.spacing_hz >= low_hz) & (index * spectra.spacing_hz <= high_hz)
    inside &= (index >= 3) & (index < len(power) - 4)
    found: dict[int, float] = {}
    places: list[int] = []
    for width in WIDTHS:
        excess = _excess(power, width)
        excess[~inside] = -np.inf
        tops = (excess == maximum_filter1d(excess, 2 * width + 5)) & (excess > 0)
        for top in np.flatnonzero(tops).tolist():
            # The nearest on either side are as good as all of them.
            at = bisect.bisect(places, top)
            beside = places[max(0, at - 1) : at + 1]
            if all(abs(top - other) > 2 * width + 2 for other in beside):
                found[top] = float(excess[top])
                places.insert(at, top)
    sharpest = sorted(found, key=lambda top: -found[top])[:MOST]
    return sorted(top * spectra.spacing_hz for top in sharpest)


def _hann_power(coefficients: np.ndarray) -> np.ndarray:
    """Power under a Hann taper, by what it does to neighbouring coefficients."""
    power: np.ndarray = np.abs(coefficients)
    for first in range(1, len(coefficients) - 1, PIECE):
        last = min(first + PIECE, len(coefficients) - 1)
        beside = coefficients[first - 1 : last - 1] + coefficients[first + 1 : last + 1]
        power[first:last] = np.abs(coefficients[first:last] - 0.5 * beside)
    power **= 2
    return power


def _excess(power: np.ndarray, width: int) -> np.ndarray:
    """Logarithm of the mean over `width` bins over what smooth noise would hardly reach."""
    around = min(SURROUNDINGS * width | 1, len(power) | 1)
    # One column at a time: the filter is a hundred times faster on one axis than on two.
    middle = [median_filter(column, size=around, mode="nearest") for column in power.T]
    floor = np.maximum(np.stack(middle, axis=1) / np.log(2.0), np.finfo(float).tiny)
    level = uniform_filter1d((power / floor).max(axis=1), width, mode="nearest")
    # A band without any power, as of a noiseless command, has no peak; its running sums may be
    # negative by rounding.
    level = np.maximum(level, np.finfo(float).tiny)
    ordinates = max(1.0, width / 1.5)
    # Each channel may be the one that shows the line.
    rare = FALSE_ALARM / power.size
    return np.asarray(np.log(level * ordinates / gammainccinv(ordinates, rare)))

"""Test whether a series about one mode cannot be a free decay."""

import numpy as np
import scipy.fft as fft
from jaxtyping import Complex, Float

from slowtime.identification.detection.mode_isolation import IsolatedSeries
from slowtime.identification.detection.resonance_peaks import PeakCandidate

from .segments import PARTS, SHORTEST

HALF_WIDTH = 16
"""Bins either side of the candidate that are looked at: a decay is judged on a dozen."""

ROOTS = 3
"""A record is explained by so many decays at most."""

EXPLAINED_AT_MOST = 0.8
"""Share of the envelope's power that so many decays would have to explain in some stretch, less
a margin for noise and for the ends of the band; what stays below is no decay."""

CONCENTRATED = 0.6
"""Two neighbouring eighths with more of the power are an event, which is looked at closely."""


def is_random(part: IsolatedSeries, candidate: PeakCandidate) -> bool:
    """Whether no long stretch of a series can be a sum of few decays.

    The envelope of a sum of p decays has a Hankel matrix of rank p, over every stretch. A mode
    under random force is driven anew within its memory, and has full rank. This costs a
    thousandth of fitting decays to all stretches.
    """
    power = np.array([np.sum(eighth**2) for eighth in np.array_split(part.series, PARTS)])
    if (power[1:] + power[:-1]).max() > CONCENTRATED * power.sum():
        return False
    envelope = _envelope(part, candidate.frequency_hz - part.shift_hz)
    if envelope is None:
        return False
    edges = np.linspace(0, len(envelope), PARTS + 1).round().astype(int)
    shares = [
        _share(envelope[edges[first] : edges[last]])
        for first in range(PARTS)
        for last in range(first + SHORTEST, PARTS + 1)
    ]
    return max(shares) < EXPLAINED_AT_MOST


def _envelope(
    part: IsolatedSeries, frequency_hz: float
) -> Complex[np.ndarray, " instant"] | None:
    """Complex envelope of the bins about a frequency, or None where there are too few."""
    count = len(part.series)
    coefficients = fft.rfft(part.series)
    centre = round(frequency_hz * count / part.rate_hz)
    if not HALF_WIDTH < centre < len(coefficients) - HALF_WIDTH - 1:
        return None
    bins = coefficients[centre - HALF_WIDTH : centre + HALF_WIDTH + 1]
    return np.asarray(fft.ifft(fft.ifftshift(bins)))


def _share(envelope: Complex[np.ndarray, " instant"]) -> float:
    """Share of the power of a Hankel matrix in its strongest directions."""
    columns = len(envelope) // 2
    hankel = np.lib.stride_tricks.sliding_window_view(envelope, columns)
    strength: Float[np.ndarray, " direction"] = np.linalg.svd(hankel, compute_uv=False) ** 2
    return float(strength[:ROOTS].sum() / max(strength.sum(), np.finfo(float).tiny))

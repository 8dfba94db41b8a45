"""Test whether a series about one mode cannot be a free decay."""

import numpy as np
import scipy.fft as fft
from jaxtyping import Complex, Float

from slowtime.identification.detection.mode_isolation import IsolatedSeries
from slowtime.identification.detection.resonance_peaks import PeakCandidate

from .segments import PARTS, SHORTEST

HALF_WIDTH = 16
"""Half-width of the band about the candidate [bins]."""

ROOTS = 3
"""Largest number of decays that explain a record."""

EXPLAINED_AT_MOST = 0.8
"""Share of the envelope's power in `ROOTS` decays below which a segment is no free decay;
leaves a margin for noise and band edges."""

CONCENTRATED = 0.6
"""Share of the power in two neighbouring eighths above which a record holds an event, and is
not tested."""


def is_random(part: IsolatedSeries, candidate: PeakCandidate) -> bool:
    """Whether no long segment of a series can be a sum of few decays."""
    power = np.array([np.sum(eighth**2) for eighth in np.array_split(part.series, PARTS)])
    if (power[1:] + power[:-1]).max() > CONCENTRATED * power.sum():
        return False
    # The envelope of a sum of p decays has a Hankel matrix of rank p, over every stretch. A
    # mode under random force is driven anew within its memory, and has full rank. This costs a
    # thousandth of fitting decays to all stretches.
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

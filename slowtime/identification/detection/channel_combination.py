"""Weighted sum of channels with the highest signal-to-noise ratio at one mode."""

import numpy as np
import scipy.linalg as la
from jaxtyping import Float

from slowtime.signals.spectra import transform

from .resonance_peaks import PeakCandidate


def modal_series(
    columns: Float[np.ndarray, "time channel"], rate_hz: float, candidate: PeakCandidate
) -> Float[np.ndarray, " time"]:
    r"""Series :math:`y = w^T x` with the greatest signal to noise at the candidate's peak.

    .. math:: w = \arg\max \frac{w^T \hat S_p w}{w^T \hat S_n w}

    with the real parts of the spectral matrices :math:`\hat S_p` averaged over the peak and
    :math:`\hat S_n` over the quieter half of the rest of its band. The scale is that of the
    channel that moves most, so amplitudes keep their meaning.
    """
    if columns.shape[1] == 1:
        return columns[:, 0]
    frequency, coefficients = transform(columns, rate_hz, taper="hann")
    peak, rest = _bins(frequency, coefficients, candidate)
    # A record without noise must not let rounding choose the weights; hence the ridge.
    signal = _matrix(coefficients[peak])
    noise = _matrix(coefficients[rest])
    noise = noise + 1e-6 * np.diag(np.diag(signal)) + 1e-300 * np.eye(len(signal))
    weights = la.eigh(signal, noise)[1][:, -1]
    participation = signal @ weights / (weights @ signal @ weights)
    largest = participation[np.argmax(np.abs(participation))]
    return np.asarray(columns @ weights * largest)


def _bins(
    frequency: np.ndarray, coefficients: np.ndarray, candidate: PeakCandidate
) -> tuple[np.ndarray, np.ndarray]:
    """Find the bins of the peak, and the quieter half of the others in an octave about it."""
    near = max(0.01 * candidate.frequency_hz, 2.0 * float(frequency[1]))
    offset = np.abs(frequency - candidate.frequency_hz)
    peak = np.flatnonzero(offset <= near)
    low = max(candidate.low_hz, candidate.frequency_hz / 2)
    high = min(candidate.high_hz, candidate.frequency_hz * 2)
    others = np.flatnonzero((offset > 2 * near) & (frequency >= low) & (frequency <= high))
    if len(others) < 4 * coefficients.shape[1]:
        others = np.flatnonzero(offset > 2 * near)
    power = np.abs(coefficients[others]) ** 2
    loudness = (power / (power.mean(axis=0) + 1e-300)).sum(axis=1)
    return peak, others[loudness <= np.median(loudness)]


def _matrix(coefficients: np.ndarray) -> np.ndarray:
    return np.asarray((coefficients.T @ coefficients.conj()).real / len(coefficients))

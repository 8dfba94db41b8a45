"""Tapers, windowed-sinc filters and fast convolution.

They answer as `scipy.signal` does, whose import an edge agent is spared; see `peaks`.
"""

from typing import Literal

import numpy as np
import scipy.fft as fft
from jaxtyping import Float

Kind = Literal["lowpass", "highpass"]

LEAST_BLOCK = 4096
"""Samples that a convolution transforms at once, at least; below, calls cost more than sums."""


def taper(name: str, count: int) -> Float[np.ndarray, " time"]:
    r"""Periodic window function [1].

    .. math:: h_n = \tfrac12 (1 - \cos(2 \pi n / N))

    for ``hann``; ``boxcar`` is 1.

    Parameters
    ----------
    name
        Name of the window.
    count
        Number of samples.

    Raises
    ------
    ValueError
        For any other name.
    """
    if name == "boxcar":
        return np.ones(count)
    if name == "hann":
        return np.asarray(0.5 - 0.5 * np.cos(2 * np.pi * np.arange(count) / count))
    raise ValueError(f"{name!r} is not a valid taper. Allowed: boxcar, hann.")


def kaiser_order(stop_db: float, width: float) -> tuple[int, float]:
    """Length and beta of a Kaiser-windowed filter.

    Parameters
    ----------
    stop_db
        Attenuation beyond the transition, above 50 [dB].
    width
        Of the transition, as a fraction of the Nyquist frequency [1].

    Returns
    -------
    Number of coefficients, and beta [1].

    References
    ----------
    .. [1] J. F. Kaiser, "Nonrecursive digital filter design using the I0-sinh window
       function", ISCAS (1974) 20-23.
    """
    if not stop_db > 50:
        raise ValueError(f"{stop_db=} is not above 50 dB, where this rule holds. Give more.")
    return int(np.ceil((stop_db - 7.95) / (2.285 * np.pi * width) + 1)), 0.1102 * (
        stop_db - 8.7
    )


def windowed_sinc(
    length: int, edge: float, beta: float, kind: Kind
) -> Float[np.ndarray, " tap"]:
    """Coefficients of a linear-phase filter, windowed by a Kaiser window of `beta`.

    Parameters
    ----------
    length
        Odd number of coefficients.
    edge
        Where the gain is a half, as a fraction of the Nyquist frequency [1].
    beta
        Shape of the Kaiser window [1].
    kind
        ``"lowpass"`` or ``"highpass"``.

    Returns
    -------
    Coefficients whose gain is 1 at frequency 0, or at the Nyquist frequency for a highpass.
    """
    place = np.arange(length) - (length - 1) / 2
    low = edge * np.sinc(edge * place)
    taps = (low if kind == "lowpass" else np.sinc(place) - low) * np.kaiser(length, beta)
    sign = 1.0 if kind == "lowpass" else np.cos(np.pi * place)
    return np.asarray(taps / np.sum(taps * sign))


def convolved(
    series: Float[np.ndarray, " time"], taps: Float[np.ndarray, " tap"]
) -> Float[np.ndarray, " valid"]:
    """Compute the valid part of a convolution by transforms of blocks.

    Parameters
    ----------
    series
        Samples.
    taps
        Impulse response.

    Returns
    -------
    Filtered samples.

    Examples
    --------
    >>> convolved(np.arange(5.0), np.array([0.5, 0.5])).round(12)
    array([0.5, 1.5, 2.5, 3.5])
    """
    overlap = len(taps) - 1
    count = len(series) - overlap
    size = fft.next_fast_len(max(LEAST_BLOCK, 8 * len(taps)), real=True)
    size = min(size, fft.next_fast_len(len(series), real=True))
    step = size - overlap
    gain = fft.rfft(taps, size)
    out = np.empty(count)
    for start in range(0, count, step):
        piece = fft.irfft(fft.rfft(series[start : start + size], size) * gain, size)
        out[start : start + step] = piece[overlap : overlap + min(step, count - start)]
    return out

"""Frequency responses from continuous excitation: averaged blocks with a Hann window."""

import math

import numpy as np
import scipy.fft as fft
from jaxtyping import Float

from slowtime.signals.finite_filters import taper

from .estimators import (
    Estimator,
    estimate_response,
    multiple_coherence,
    random_error,
    spectral_matrices,
)
from .response import FrequencyResponse, Kind

BLOCKS = 16
"""Blocks that a record is divided into by default, besides those that overlap."""

OVERLAP_LOSS = 1.9
"""[1] Blocks with a Hann window that overlap by half are worth 1.9 times those side by side
(P. D. Welch, IEEE Trans. Audio Electroacoustics 15, 1967)."""


def block_samples(count: int) -> int:
    """Length of a block: a power of two, of about a sixteenth of the record.

    Examples
    --------
    >>> block_samples(100_000)
    4096
    """
    return int(2 ** max(5, math.floor(math.log2(count / BLOCKS))))


def shaker_response(
    inputs: Float[np.ndarray, "time input"],
    outputs: Float[np.ndarray, "time output"],
    rate_hz: float,
    *,
    kind: Kind = "acceleration",
    estimator: Estimator = "h1",
) -> FrequencyResponse:
    """Average frequency responses over blocks that overlap by half.

    The leakage of resonances that are narrower than four lines is a bias besides, which the
    random errors do not contain. Raises `ValueError` where inputs are coherent, or the record
    is shorter than a block.
    """
    count = len(inputs)
    size = block_samples(count)
    if size > count:
        raise ValueError(
            f"{count} samples are too few for a frequency response. Give a record of at least "
            f"{size} samples."
        )
    starts = np.arange(0, count - size + 1, max(1, size // 2))
    rows = starts[:, None] + np.arange(size)
    window = taper("hann", size)[:, None]
    u, y = (
        fft.rfft((x[rows] - x[rows].mean(axis=1, keepdims=True)) * window, axis=1)
        for x in (inputs, outputs)
    )
    averages = max(1.0, count / size * OVERLAP_LOSS - 1.0) if len(starts) > 1 else 1.0
    spectra = spectral_matrices(u, y, averages=min(averages, float(len(starts))))
    lines = slice(1, None)
    return FrequencyResponse(
        frequency_hz=fft.rfftfreq(size, 1 / rate_hz)[lines],
        response=estimate_response(spectra, estimator)[lines],
        sd=random_error(spectra)[lines],
        coherence=multiple_coherence(spectra)[lines],
        averages=int(averages),
        kind=kind,
    )

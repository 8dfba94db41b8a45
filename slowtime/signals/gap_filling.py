r"""Filling of short gaps by linear prediction from both sides.

A sample :math:`x_k` that is missing is estimated by the best linear predictor from the samples
around it,

.. math:: \hat x_m = R_{mo} R_{oo}^{-1} x_o, \qquad
   e^2 = \operatorname{tr}(R_{mm} - R_{mo} R_{oo}^{-1} R_{om}) / \operatorname{tr} R_{mm}

with the autocovariance :math:`R` of the record itself. Where its spectrum leaves room below the
Nyquist frequency, or is made of narrow lines, :math:`e` is small; of white noise it is 1, and
nothing can be bridged.

References
----------
.. [1] A. Janssen, R. Veldhuis, L. Vries, "Adaptive interpolation of discrete-time signals that
   can be modeled as autoregressive processes", IEEE Trans. ASSP 34 (1986) 317-330.
"""

import dataclasses

import numpy as np
import scipy.linalg
from jaxtyping import Bool, Float

REACH = 48
"""Samples on either side from which one that is missing is estimated."""
RIDGE = 1e-9
"""Of the variance, added to it: keeps a covariance estimated from gappy samples solvable."""


@dataclasses.dataclass(frozen=True, slots=True)
class Bridged:
    """A record without its losses.

    Parameters
    ----------
    samples
        As given, with estimates where samples were missing.
    error
        Expected mean square error of the estimates, in the variance of its channel: the worst
        channel's [1].
    """

    samples: Float[np.ndarray, "time channel"]
    error: float


def bridge(
    samples: Float[np.ndarray, "time channel"], present: Bool[np.ndarray, " time"]
) -> Bridged:
    """Estimate missing samples from those around them.

    Parameters
    ----------
    samples
        One row per instant; rows that are missing may hold anything.
    present
        Which rows were measured. The first and the last must have been.

    Returns
    -------
    Samples with gaps filled, and the expected error of the worst channel [1].

    Raises
    ------
    ValueError
        Where less than half of the rows were measured, or too few to know their spectrum.
    """
    if len(present) < 8 * REACH or present.mean() < 0.5 or not (present[0] and present[-1]):
        raise ValueError(
            f"{np.count_nonzero(present)} of {len(present)} samples are there. At least half "
            f"of {8 * REACH} or more are needed, the first and the last among them."
        )
    filled = np.where(present[:, None], samples, 0.0).astype(float)
    worst = 0.0
    runs = runs_missing(present)
    for channel in range(samples.shape[1]):
        mean = filled[present, channel].mean()
        series = np.where(present, filled[:, channel] - mean, 0.0)
        covariance = _autocovariance(series, present)
        error = _fill(series, present, runs, covariance)
        filled[:, channel] = series + mean
        worst = max(worst, error)
    return Bridged(filled, worst)


def _autocovariance(
    series: Float[np.ndarray, " time"], present: Bool[np.ndarray, " time"]
) -> Float[np.ndarray, " lag"]:
    """Means of products of the pairs that are there, by lag, made positive definite.

    A mean over other pairs for each lag need not be a covariance: its spectrum is held above
    zero.
    """
    lags = 4 * REACH
    size = 1 << int(np.ceil(np.log2(len(series) + lags)))
    spectrum = np.fft.rfft(series, size)
    counts = np.fft.irfft(np.abs(np.fft.rfft(present.astype(float), size)) ** 2, size)
    products = np.fft.irfft(np.abs(spectrum) ** 2, size)
    found = products[:lags] / np.maximum(counts[:lags], 1.0)
    # A taper leaves the near lags, which are used, nearly as they are, and ends the last ones
    # at zero: samples on either side of a longer gap are taken for uncorrelated.
    taper = np.cos(0.5 * np.pi * np.arange(lags) / lags) ** 2
    two_sided = np.concatenate([found * taper, (found * taper)[-1:0:-1]])
    power = np.maximum(np.fft.rfft(two_sided).real, 0.0)
    return np.append(np.fft.irfft(power, len(two_sided))[:lags], 0.0)


def runs_missing(present: Bool[np.ndarray, " time"]) -> list[tuple[int, int]]:
    """First and after-last row of each run of missing samples.

    Returns
    -------
    Runs, ascending.
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([1], present.astype(int), [1]))))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _fill(
    series: Float[np.ndarray, " time"],
    present: Bool[np.ndarray, " time"],
    runs: list[tuple[int, int]],
    covariance: Float[np.ndarray, " lag"],
) -> float:
    """Put estimates into `series`; their mean square error, in the variance."""
    known: dict[tuple[int, bytes], tuple[np.ndarray, float]] = {}
    errors: list[float] = []
    if covariance[0] <= 0:
        return 0.0  # a constant, which is its own estimate
    estimates: list[tuple[int, int, np.ndarray]] = []
    for first, last in runs:
        low, high = max(first - REACH, 0), min(last + REACH, len(series))
        around = present[low:high]
        key = (first - low, around.tobytes())
        if key not in known:
            known[key] = _weights(around, first - low, last - low, covariance)
        weights, error = known[key]
        estimates.append((first, last, weights @ series[low:high][around]))
        errors += [error] * (last - first)
    for first, last, values in estimates:
        series[first:last] = values
    return float(np.mean(errors)) if errors else 0.0


def _weights(
    around: Bool[np.ndarray, " near"],
    first: int,
    last: int,
    covariance: Float[np.ndarray, " lag"],
) -> tuple[Float[np.ndarray, "missing there"], float]:
    """Weights of the samples around, and the relative error of the estimates."""
    there = np.flatnonzero(around)
    missing = np.arange(first, last)
    reach = np.minimum(np.abs(there[:, None] - there[None, :]), len(covariance) - 1)
    matrix = covariance[reach] + RIDGE * covariance[0] * np.eye(len(there))
    across = covariance[np.minimum(np.abs(missing[:, None] - there), len(covariance) - 1)]
    weights = scipy.linalg.solve(matrix, across.T, assume_a="sym").T
    left = covariance[0] - np.einsum("ij,ij->i", weights, across)
    return weights, float(np.clip(left.mean() / covariance[0], 0.0, 1.0))

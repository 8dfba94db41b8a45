r"""Imputation of missing samples: drawn from what the samples around them allow.

Best linear prediction of the samples of a gap is too smooth: a lightly damped structure is then
driven less within gaps than elsewhere, and its damping comes out too low. A draw from the
conditional distribution,

.. math:: x_m = R_{mo} R_{oo}^{-1} x_o + L \epsilon, \qquad
   L L^T = R_{mm} - R_{mo} R_{oo}^{-1} R_{om} ,

has the spectrum of the record [1]_. :math:`R` is the covariance of all channels together, from
the lagged products of the pairs that exist [2]_, kept positive definite. Samples of longer gaps
are drawn piece by piece, each given those before it and those behind the gap.

References
----------
.. [1] D. B. Rubin, "Multiple Imputation for Nonresponse in Surveys" (1987): a mean in place of
   a draw distorts every estimate of spread.
.. [2] E. Parzen, "On spectral analysis with missing observations and amplitude modulation",
   Sankhya A 25 (1963); R. H. Jones, "Spectral analysis with regularly missed observations",
   Ann. Math. Statist. 33 (1962).
"""

import dataclasses

import numpy as np
import scipy.fft as fft
import scipy.linalg
from jaxtyping import Bool, Float

from .gap_filling import runs_missing

REACH = 48
"""Samples on either side that a draw is given, at most."""

GIVEN = 768
"""Values, channels times samples, that a draw is given, at most: their covariance is solved
for each pattern of gaps."""

PIECE = 48
"""Samples of a gap that are drawn at once."""

FEWEST_LAGS, MOST_LAGS = 4 * REACH, 2048
LAG_SHARE = 1 / 16
"""Lags of the covariance: a share of the record [1], within limits. Fewer lags blur narrow
peaks; more of them scatter."""

PREDICTING_LAG_SHARE = 1 / 2
"""The same where samples are predicted: products of a decay do not scatter."""

ROUNDS = 4
"""Rounds of prediction and covariance after the first: the products that are missing in the
loud part of a decay are not like those that exist elsewhere."""

RIDGE = 1e-9
"""Added to the variances [1]: keeps a covariance of noiseless channels solvable."""

LEAST_SHARE = 0.5
"""Least share of samples that must be there [1]."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Imputed:
    """A record without gaps.

    Parameters
    ----------
    samples
        As given, with draws where samples were missing.
    spread
        Mean variance of the draws given the samples around them, relative to that of their
        channel [1].
    """

    samples: Float[np.ndarray, "time channel"]
    spread: float


def impute(
    samples: Float[np.ndarray, "time channel"],
    present: Bool[np.ndarray, " time"],
    *,
    rng: np.random.Generator | None,
) -> Imputed:
    """Draw the missing samples of a record given those around them.

    Parameters
    ----------
    samples
        One row per instant; rows that are missing may hold anything.
    present
        Which rows were measured; the first and the last must have been.
    rng
        Of the draws; None for the best linear prediction, which records of decaying level
        need, because the spread of a draw is that of the whole record.

    Returns
    -------
    Samples, those that were measured as they are, and how free the draws were.

    Raises
    ------
    ValueError
        Where less than half of the rows were measured, or too few to know their covariance.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> present = rng.random(10_000) > 0.1
    >>> present[[0, -1]] = True
    >>> noise = rng.standard_normal((10_000, 1))
    >>> bool(abs(impute(noise, present, rng=rng).samples[~present].std() - 1.0) < 0.1)
    True
    """
    count, channels = samples.shape
    if count < 2 * FEWEST_LAGS or present.mean() < LEAST_SHARE or not present[[0, -1]].all():
        raise ValueError(
            f"{np.count_nonzero(present)} of {count} samples are there. At least "
            f"{100 * LEAST_SHARE:.0f} % of {2 * FEWEST_LAGS} or more are needed, the first and "
            "the last among them."
        )
    mean, scale = samples[present].mean(axis=0), samples[present].std(axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    series = np.where(present[:, None], (samples - mean) / scale, 0.0)
    reach = max(4, min(REACH, GIVEN // (2 * channels)))
    covariance = _covariance(series, present, _lags(count, LAG_SHARE))
    left = _draw_all(series, present, _Drawing(covariance, reach, rng))
    for _ in range(ROUNDS if rng is None else 0):
        covariance = _covariance(series, present | True, _lags(count, PREDICTING_LAG_SHARE))
        left = _draw_all(series, present, _Drawing(covariance, reach, None))
    drawn = series[~present] * scale + mean
    whole = np.array(samples, dtype=float)
    whole[~present] = drawn
    total = max(np.count_nonzero(~present), 1) * np.trace(covariance[0])
    return Imputed(whole, float(left / max(total, np.finfo(float).tiny)))


def _lags(count: int, share: float) -> int:
    return int(np.clip(count * share, FEWEST_LAGS, MOST_LAGS))


def _draw_all(series: np.ndarray, present: np.ndarray, drawing: "_Drawing") -> float:
    """Put draws into all gaps of a series; the sum of their variances."""
    known = present.copy()
    return sum(
        drawing.draw(series, known, slice(begin, min(begin + PIECE, last)), last)
        for first, last in runs_missing(present)
        for begin in range(first, last, PIECE)
    )


def _covariance(
    series: Float[np.ndarray, "time channel"], present: Bool[np.ndarray, " time"], lags: int
) -> Float[np.ndarray, "lag channel channel"]:
    """Means of the lagged products of the pairs that exist, made positive definite.

    Means over other pairs for each lag need not form a covariance: the eigenvalues of its
    spectral matrices are held above zero.
    """
    count, channels = series.shape
    size = fft.next_fast_len(count + lags, real=True)
    there = np.abs(fft.rfft(present.astype(float), size)) ** 2
    pairs = np.maximum(fft.irfft(there, size)[:lags], 1.0)
    taper = np.cos(0.5 * np.pi * np.arange(lags) / lags) ** 2 / pairs
    spectra = fft.rfft(series, size, axis=0)
    two_sided = np.zeros((2 * lags, channels, channels))
    for i in range(channels):
        for j in range(channels):
            found = fft.irfft(spectra[:, i] * spectra[:, j].conj(), size)[:lags] * taper
            two_sided[:lags, i, j] = found
            two_sided[:-lags:-1, j, i] = found[1:]
    matrices = fft.rfft(two_sided, axis=0)
    power, directions = np.linalg.eigh((matrices + matrices.conj().transpose(0, 2, 1)) / 2)
    kept = (directions * np.maximum(power, 0.0)[:, None]) @ directions.conj().transpose(0, 2, 1)
    return np.asarray(fft.irfft(kept, 2 * lags, axis=0)[:lags])


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Drawing:
    """Draws of pieces of gaps; weights are kept for patterns that come again."""

    covariance: Float[np.ndarray, "lag channel channel"]
    reach: int
    rng: np.random.Generator | None
    weights: dict[tuple[int, int, bytes], tuple[np.ndarray, np.ndarray]] = dataclasses.field(
        default_factory=dict
    )

    def draw(self, series: np.ndarray, known: np.ndarray, piece: slice, end: int) -> float:
        """Put a piece of a gap that ends before `end` into a series; the sum of its variances.

        Each piece is given both ends of the gap: a mode whose memory is longer than the gap
        would otherwise jump in phase where the last piece meets what was measured.
        """
        first, last = piece.start, piece.stop
        low, high = max(first - self.reach, 0), min(end + self.reach, len(series))
        around = known[low:high]
        key = (first - low, last - low, around.tobytes())
        if key not in self.weights:
            self.weights[key] = self._solved(around, first - low, last - low)
        onto, root = self.weights[key]
        values = onto @ series[low:high][around].ravel()
        if self.rng is not None:
            values = values + root @ self.rng.standard_normal(root.shape[1])
        series[first:last] = values.reshape(last - first, -1)
        known[first:last] = True
        return float(np.sum(root**2))

    def _solved(
        self, around: np.ndarray, first: int, last: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Weights of the values around, and the root of the covariance that they leave."""
        there, missing = np.flatnonzero(around), np.arange(first, last)
        within = self._between(there, there)
        within += RIDGE * np.trace(within) / len(within) * np.eye(len(within))
        across = self._between(missing, there)
        onto = scipy.linalg.solve(within, across.T, assume_a="pos").T
        left = self._between(missing, missing) - onto @ across.T
        power, directions = np.linalg.eigh((left + left.T) / 2)
        return onto, directions * np.sqrt(np.maximum(power, 0.0))

    def _between(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Covariance of all channels at some instants with those at others."""
        lag = one[:, None] - other
        blocks = self.covariance[np.minimum(np.abs(lag), len(self.covariance) - 1)]
        blocks = np.where((lag >= 0)[:, :, None, None], blocks, blocks.transpose(0, 1, 3, 2))
        channels = blocks.shape[-1]
        blocks = blocks.transpose(0, 2, 1, 3)
        return np.asarray(blocks.reshape(len(one) * channels, len(other) * channels))

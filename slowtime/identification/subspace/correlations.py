r"""Correlation matrices of a multichannel series, with draws of their errors.

The error of a mean of products over time is normal, with a covariance set by the density at
frequency zero of those products. Cosine transforms of the products, one for each of the lowest
frequencies, are independent and have just that covariance: a few dozen draws carry the whole
uncertainty, and whatever is computed from correlations is differentiated along each of them.
"""

import dataclasses

import numpy as np
from jaxtyping import Float, Inexact

MOST_DRAWS = 48
"""Largest number of error draws."""

BLOCKS_PER_DRAW = 2
"""Number of blocks per error draw."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Correlations:
    r"""Correlations of all channels with the references, at lags from 0 up.

    Parameters
    ----------
    mean
        :math:`R_\tau = \mathrm{E}\, y_{t+\tau} r_t^H`.
    draws
        Draws of the error of the mean, slowest first.
    centre_hz
        Frequency that was moved to zero before [Hz].
    """

    mean: Inexact[np.ndarray, "lag channel reference"]
    draws: Inexact[np.ndarray, "draw lag channel reference"]
    rate_hz: float
    duration_s: float
    centre_hz: float = 0.0


def block_products(
    series: Inexact[np.ndarray, "time channel"],
    references: Inexact[np.ndarray, "time reference"],
    *,
    lags: int,
    length: int,
) -> Inexact[np.ndarray, "block lag channel reference"]:
    r"""Sum of :math:`y_{t+\tau} r_t^H` over blocks of `length` instants t, for each lag.

    Pairs that reach beyond the last sample are missing from the last blocks, which
    `correlation_matrices` corrects. Samples after the last whole block serve only in pairs.
    """
    blocks = len(references) // length
    used = blocks * length
    padding = np.zeros((max(0, used + lags - len(series)), series.shape[1]), series.dtype)
    padded = np.concatenate([series[: used + lags], padding])
    before = references[:used].reshape(blocks, length, -1).conj()
    after = [
        padded[lag : lag + used].reshape(blocks, length, -1).transpose(0, 2, 1) @ before
        for lag in range(lags)
    ]
    return np.stack(after, axis=1)


def correlation_matrices(
    series: Inexact[np.ndarray, "time channel"],
    references: Inexact[np.ndarray, "time reference"],
    *,
    lags: int,
    rate_hz: float,
    centre_hz: float = 0.0,
    draws: int = MOST_DRAWS,
) -> Correlations:
    """Correlate a whole series of zero mean with its references.

    References may be channels of the series, or mixtures of them. There are at most `draws`
    draws of the error, fewer where the series is short.

    Examples
    --------
    >>> noise = np.random.default_rng(1).standard_normal((100_000, 1))
    >>> found = correlation_matrices(noise, noise, lags=2, rate_hz=1.0)
    >>> found.mean[:, 0, 0].round(1) + 0
    array([1., 0.])
    >>> bool(abs(np.std(found.draws[:, 1]) * 100_000**0.5 - 1.0) < 0.3)
    True
    """
    count = len(series)
    blocks = min(BLOCKS_PER_DRAW * draws, count // 4)
    if blocks < 4 or count <= 2 * lags:
        raise ValueError(
            f"A series of {count} instants was given for {lags} lags. At least "
            f"{max(16, 2 * lags + 1)} are needed; record longer or ask for fewer lags."
        )
    length = count // blocks
    products = block_products(series, references, lags=lags, length=length)
    starts = length * np.arange(len(products))[:, None]
    pairs = np.clip(count - np.arange(lags) - starts, 0, length).astype(float)
    return combine_products(products, pairs, rate_hz=rate_hz, centre_hz=centre_hz, draws=draws)


def combine_products(
    products: Inexact[np.ndarray, "block lag channel reference"],
    pairs: Float[np.ndarray, "block lag"],
    *,
    rate_hz: float,
    centre_hz: float = 0.0,
    draws: int = MOST_DRAWS,
) -> Correlations:
    r"""Mean of the products of successive blocks, and draws of its error.

    .. math:: T_k = \sqrt{2} \sum_b \cos\!\left(\pi k \frac{b + 1/2}{B}\right)
              \frac{P_b - n_b R}{N}, \qquad k = 1 \dots K

    with b in steps of equal weight, so that blocks may be of different length or faded.

    Parameters
    ----------
    products, pairs
        Sums of products and how many (or of what total weight) went into them.

    References
    ----------
    .. [1] U. K. Müller, "A theory of robust long-run variance estimation", J. Econometrics
       141 (2007): cosine-weighted sums, and Student's law with K degrees of freedom.
    """
    total = pairs.sum(axis=0)
    mean = products.sum(axis=0) / total[:, None, None]
    weight = pairs.max(axis=1)
    place = (np.cumsum(weight) - 0.5 * weight) / weight.sum()
    number = max(2, min(draws, len(products) // BLOCKS_PER_DRAW))
    waves = np.sqrt(2.0) * np.cos(np.pi * np.outer(np.arange(1, number + 1), place))
    error = (products - pairs[:, :, None, None] * mean) / total[:, None, None]
    spread = np.tensordot(waves, error, axes=1)
    return Correlations(mean, spread, rate_hz, float(weight.sum()) / rate_hz, centre_hz)


def block_hankel(
    lagged: Inexact[np.ndarray, "lag channel reference"], rows: int, columns: int
) -> Inexact[np.ndarray, "row column"]:
    """Hankel matrix whose block (i, j) is the correlation at lag i + j."""
    index = np.arange(rows)[:, None] + np.arange(columns)
    blocks = lagged[index].transpose(0, 2, 1, 3)
    return np.asarray(blocks.reshape(rows * lagged.shape[1], columns * lagged.shape[2]))

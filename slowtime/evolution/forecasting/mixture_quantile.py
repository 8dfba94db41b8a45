"""Quantiles of mixtures of Gaussian distributions."""

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr, ndtri

_HALVINGS = 40


def mixture_quantile(
    share: float,
    weights: Float[np.ndarray, " member"] | Float[np.ndarray, "member later"],
    means: Float[np.ndarray, "member later"],
    spreads: Float[np.ndarray, "member later"],
) -> Float[np.ndarray, " later"]:
    """Quantile of a Gaussian mixture at each time.

    Weights may differ from time to time.

    Parameters
    ----------
    share
        Probability below the quantile.
    weights
        Weights of the members.
    means
        Means, member by time.
    spreads
        Standard deviations, member by time.

    Examples
    --------
    >>> mixture_quantile(0.975, np.ones(1), np.zeros((1, 1)), np.ones((1, 1))).round(4)
    array([1.96])
    """
    spreads = np.maximum(spreads, 1e-300)
    each = means + ndtri(share) * spreads
    shares = weights if weights.ndim == 2 else weights[:, None]
    low, high = each.min(axis=0), each.max(axis=0)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        below = np.sum(shares * ndtr((middle - means) / spreads), axis=0) < share
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray(0.5 * (low + high))

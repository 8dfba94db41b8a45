"""How often a gain of likelihood comes about where nothing is missing."""

import numpy as np
from scipy.special import binom, chdtrc


def gain_probability(gain: float, bands: int, places: int = 1) -> float:
    r"""Probability of a gain of log likelihood at least this large, by chance alone.

    Each of `bands` variances is either held at zero, with probability one half, or free; so
    twice the gain is a mixture of chi squares,
    :math:`\sum_j \binom{B}{j} 2^{-B} P(\chi^2_j > 2 g)`; and the best of several places is
    looked at.

    References
    ----------
    .. [1] S. G. Self, K.-Y. Liang, "Asymptotic properties of maximum likelihood estimators and
       likelihood ratio tests under nonstandard conditions", JASA 82 (1987), case 9.

    Examples
    --------
    >>> gain_probability(0.0, 10)
    1.0
    >>> round(gain_probability(1.353, 1), 3)
    0.05
    """
    if gain <= 0 or bands == 0:
        return 1.0
    free = np.arange(1, bands + 1)
    weight = binom(bands, free) / 2.0**bands
    chance = float(weight @ chdtrc(free, 2 * gain))
    return min(1.0, places * chance)

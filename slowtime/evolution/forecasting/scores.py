r"""Scores of forecasts against the truth: CRPS and coverage.

The continuous ranked probability score (Gneiting and Raftery, 2007) is a distance between what
was foretold and what came, in the unit of the quantity: smaller is better, and neither too
wide nor too narrow a band can win.
"""

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import ndtr

Values = Float[np.ndarray, "*any"]


def crps(truth: Values, mean: Values, sd: Values) -> Values:
    """Continuous ranked probability score of Gaussian forecasts.

    Parameters
    ----------
    truth
        True values.
    sd
        Standard deviations; where one is 0, the score is the absolute error.

    Returns
    -------
    Score of each forecast, in the unit of the values.

    Examples
    --------
    >>> crps(np.zeros(1), np.zeros(1), np.ones(1)).round(4)
    array([0.2337])
    """
    spread = np.where(sd > 0.0, sd, 1.0)
    z = (truth - mean) / spread
    density = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
    score = spread * (z * (2.0 * ndtr(z) - 1.0) + 2.0 * density - 1.0 / np.sqrt(np.pi))
    return np.asarray(np.where(sd > 0.0, score, np.abs(truth - mean)))


def covered(truth: Values, lo: Values, hi: Values) -> Bool[np.ndarray, "*any"]:
    """Whether each truth lies within its interval.

    Returns
    -------
    Flags.
    """
    return np.asarray((lo <= truth) & (truth <= hi))

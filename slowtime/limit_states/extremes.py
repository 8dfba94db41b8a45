r"""Extreme-value law of a load from the largest values of past periods.

The Gumbel distribution by L-moments,

.. math:: \beta = \lambda_2 / \ln 2, \qquad \mu = \lambda_1 - \gamma \beta ,

which errs less on few values than moments do.

References
----------
.. [1] J. R. M. Hosking, "L-moments: analysis and estimation of distributions using linear
   combinations of order statistics", J. R. Stat. Soc. B 52 (1990) 105-124.
"""

import math

import numpy as np
from jaxtyping import Float

from slowtime.reliability import Marginal, marginal

FEWEST = 8
"""Periods from which a law is fitted: with fewer the scale is wrong by 30 % or more."""


def gumbel_of_maxima(maxima: Float[np.ndarray, " period"]) -> Marginal:
    """Gumbel distribution of the largest value of a period.

    Parameters
    ----------
    maxima
        Largest value of each past period, in the unit of the load.

    Returns
    -------
    The distribution.

    Raises
    ------
    ValueError
        For fewer than `FEWEST` periods, or values that are all the same or not finite.

    Examples
    --------
    >>> law = gumbel_of_maxima(np.array([3.1, 2.7, 3.9, 3.3, 2.9, 4.4, 3.0, 3.6]))
    >>> float(law.law.mean().round(2))
    3.36
    """
    if len(maxima) < FEWEST or not np.isfinite(maxima).all() or np.ptp(maxima) == 0.0:
        raise ValueError(
            f"{len(maxima)} largest values were given. Give {FEWEST} at least, finite and not "
            "all alike; or state the load's distribution."
        )
    ordered = np.sort(maxima)
    count = len(ordered)
    first = float(ordered.mean())
    share = np.arange(count) / (count - 1.0)
    second = 2.0 * float(np.mean(share * ordered)) - first
    scale = second / math.log(2.0)
    mean, sd = first, scale * math.pi / math.sqrt(6.0)
    return marginal("gumbel", mean=mean, sd=sd)

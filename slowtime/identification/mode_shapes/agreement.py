"""Weighted mean of several measurements, and a test of their agreement."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc

from slowtime.identification.estimates import Measured

DOUBT = 0.05
"""Significance level of the test of agreement."""


@dataclasses.dataclass(frozen=True, slots=True)
class Agreement:
    """Chi-square of measurements about their mean, and its probability if nothing differs."""

    chi_square: float
    freedom: int
    p_value: float

    @property
    def holds(self) -> bool:
        """Whether the measurements may be of one and the same value."""
        return self.p_value >= DOUBT


def agreement_of(chi_square: float, freedom: int) -> Agreement:
    """Agreement from a chi-square statistic; holds without degrees of freedom."""
    p = float(chdtrc(freedom, chi_square)) if freedom > 0 else 1.0
    return Agreement(float(chi_square), freedom, p)


def weighted_mean(measured: list[Measured]) -> tuple[Measured, Agreement, np.ndarray]:
    r"""Mean weighted by inverse variances, its agreement, and the weights.

    Where the measurements disagree each has, beside its own, a variance :math:`\tau^2` from
    measurement to measurement, the one that makes chi-square what it should be:

    .. math:: \sum_i \frac{(x_i - \bar x)^2}{\sigma_i^2 + \tau^2} = n - 1 ,

    and the standard deviation of the mean grows accordingly.

    References
    ----------
    .. [1] R. C. Paule, J. Mandel, "Consensus values and weighting factors", J. Research of the
       National Bureau of Standards 87 (1982).

    Examples
    --------
    >>> mean, agreement, _ = weighted_mean([Measured(1.0, 0.1), Measured(1.1, 0.1)])
    >>> round(mean.value, 3), round(mean.sd, 4), agreement.holds
    (1.05, 0.0707, True)
    >>> mean, agreement, _ = weighted_mean([Measured(1.0, 0.1), Measured(2.0, 0.1)])
    >>> round(mean.value, 3), round(mean.sd, 4), agreement.holds
    (1.5, 0.5, False)
    """
    values = np.array([one.value for one in measured])
    variances = np.array([one.sd**2 for one in measured])
    agreement = agreement_of(_chi_square(values, variances), len(values) - 1)
    if not agreement.holds:
        from scipy.optimize import brentq  # here: an edge agent that never needs it saves 16 MB

        widest = float(np.ptp(values)) ** 2
        between = brentq(
            lambda extra: _chi_square(values, variances + extra) - agreement.freedom,
            0.0,
            widest,
        )
        variances = variances + between
    weights = (1 / variances) / np.sum(1 / variances)
    sd = float(np.sqrt(1 / np.sum(1 / variances)))
    return Measured(float(weights @ values), sd), agreement, weights


def _chi_square(
    values: Float[np.ndarray, " measurement"], variances: Float[np.ndarray, " measurement"]
) -> float:
    mean = np.average(values, weights=1 / variances)
    return float(np.sum((values - mean) ** 2 / variances))

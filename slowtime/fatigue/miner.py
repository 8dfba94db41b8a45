r"""Miner's sum as a random variable, and the time until it is used up.

.. math:: D = A \sum_i \frac{n_i}{N(S_i)}, \qquad \text{failure where } D \ge \Delta

with lognormal factors: A for the life of this specimen among all (S-N scatter) and for an error
of the stress, raised to the slope; and the capacity :math:`\Delta`, which Miner's rule takes
for 1 and which tests scatter about.

References
----------
.. [1] M. A. Miner, "Cumulative damage in fatigue", J. Appl. Mech. 12 (1945) A159-A164.
.. [2] P. H. Wirsching, Y.-N. Chen, "Considerations of probability-based fatigue design for
   marine structures", Marine Structures 1 (1988) 23-45: capacity of median 1 and coefficient of
   variation 0.3.
"""

import dataclasses
import math

import numpy as np
from scipy.special import log_ndtr, ndtri

from .curves import SNCurve
from .histogram import Histogram

NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(21)
"""Of quadrature over a rate that is not known exactly."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Capacity:
    """Sum of damage at failure: lognormal.

    Parameters
    ----------
    median
        [1]
    variation
        Coefficient of variation [1].
    """

    median: float = 1.0
    variation: float = 0.3

    @property
    def ln_sd(self) -> float:
        """Standard deviation of the logarithm [1]."""
        return math.sqrt(math.log1p(self.variation**2))


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class MinerSum:
    """A sum of damage: lognormal.

    Parameters
    ----------
    median
        By the median curve [1].
    ln_sd
        Standard deviation of the logarithm [1].
    slope
        Slope of the S-N curve that weighs, d ln D / d ln S [1].

    Examples
    --------
    >>> total = MinerSum.of(SNCurve(constant=1e12, slope=3.0, log10_sd=0.2), 0.1, 0.1)
    >>> low, high = total.interval(0.90)
    >>> round(low, 3), round(high, 3), round(total.sd, 3)
    (0.047, 0.213, 0.054)
    """

    median: float
    ln_sd: float
    slope: float

    @classmethod
    def of(cls, curve: SNCurve, damage: float, upper_damage: float) -> "MinerSum":
        """Make the sum from the damage by the median curve and its part above the knee.

        Parameters
        ----------
        curve
            S-N curve.
        damage
            Damage by the median curve [1].
        upper_damage
            Part of it that is done by ranges above the knee [1].

        Returns
        -------
        The sum; its slope is weighted by both parts.
        """
        lower = curve.slope if curve.lower_slope is None else curve.lower_slope
        share = upper_damage / damage if damage > 0 else 1.0
        slope = share * curve.slope + (1 - share) * lower
        return cls(median=damage, ln_sd=curve.ln_sd, slope=slope)

    def with_stress_error(self, ln_sd: float, factor: float = 1.0) -> "MinerSum":
        """Include an error of all stresses by one lognormal factor.

        Parameters
        ----------
        ln_sd
            Standard deviation of the logarithm of true over estimated stress [1].
        factor
            Median of true over estimated stress [1].

        Returns
        -------
        The sum with the error included.
        """
        return dataclasses.replace(
            self,
            median=self.median * factor**self.slope,
            ln_sd=math.hypot(self.ln_sd, self.slope * ln_sd),
        )

    @property
    def mean(self) -> float:
        """Expected sum [1]."""
        return self.median * math.exp(self.ln_sd**2 / 2)

    @property
    def sd(self) -> float:
        """Standard deviation of the sum [1]."""
        return self.mean * math.sqrt(math.expm1(self.ln_sd**2))

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Interval that holds the sum with probability `level`.

        Parameters
        ----------
        level
            Probability [1].

        Returns
        -------
        Lower and upper end [1].
        """
        reach = float(ndtri((1 + level) / 2)) * self.ln_sd
        return self.median * math.exp(-reach), self.median * math.exp(reach)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class TimeToFailure:
    r"""Time from now until Miner's sum reaches the capacity, given that it has not yet.

    With :math:`X = \Delta / A` lognormal about the median capacity, damage d by the median
    curve so far and r per second from now on, :math:`P(T \le t) = E_r[(F_X(d + r t) - F_X(d)) /
    (1 - F_X(d))]`.

    Parameters
    ----------
    damage
        So far, by the median curve [1].
    rate
        Damage a second from now on [1/s].
    rate_variation
        Coefficient of variation of the rate, which is lognormal [1].
    ln_sd
        Of X: scatter of lives, capacity and stress together [1].
    capacity
        Median of the capacity [1].
    """

    damage: float
    rate: float
    rate_variation: float
    ln_sd: float
    capacity: float = 1.0

    @classmethod
    def of(
        cls,
        total: MinerSum,
        rate: float,
        *,
        rate_variation: float = 0.0,
        capacity: Capacity | None = None,
    ) -> "TimeToFailure":
        """Make the time to failure from a sum and the rate at which it grows.

        Parameters
        ----------
        total
            Miner's sum so far.
        rate
            Damage a second from now on, by the median curve [1/s].
        rate_variation
            Coefficient of variation of the rate [1].
        capacity
            Capacity; by default that of `Capacity()`.

        Returns
        -------
        Distribution of the time to failure.

        Raises
        ------
        ValueError
            Where the rate is negative or not a number.
        """
        if not rate >= 0:
            raise ValueError(f"rate={rate} is not allowed. Give damage a second, 0 or more.")
        capacity = Capacity() if capacity is None else capacity
        return cls(
            damage=total.median,
            rate=rate,
            rate_variation=rate_variation,
            ln_sd=math.hypot(total.ln_sd, capacity.ln_sd),
            capacity=capacity.median,
        )

    def probability(self, seconds: float) -> float:
        """Probability that the capacity is reached within a time from now.

        Parameters
        ----------
        seconds
            Time from now [s].

        Returns
        -------
        Probability [1].
        """
        spread = math.sqrt(math.log1p(self.rate_variation**2))
        then = self.damage + self.rate * np.exp(spread * NODES) * seconds
        survival = np.exp(self._log_survival(then) - self._log_survival(self.damage))
        return float(1 - (WEIGHTS @ survival) / WEIGHTS.sum())

    @property
    def used_up(self) -> float:
        """Probability that so much damage is failure, for one of many specimens [1]."""
        return float(-np.expm1(self._log_survival(self.damage)))

    def quantile(self, probability: float) -> float:
        """Time within which the capacity is reached with a given probability.

        Parameters
        ----------
        probability
            Probability, between 0 and 1.

        Returns
        -------
        Time from now [s]; infinite where the rate is 0.

        Raises
        ------
        ValueError
            Where the probability is not between 0 and 1.
        """
        if not 0 < probability < 1:
            raise ValueError(f"{probability=} is not allowed. Give one between 0 and 1.")
        if self.rate == 0:
            return math.inf
        low = math.log(self.capacity / self.rate) - 60.0
        high = low + 120.0
        for _ in range(80):
            middle = (low + high) / 2
            if self.probability(math.exp(middle)) < probability:
                low = middle
            else:
                high = middle
        return math.exp(high)

    def _log_survival(self, damage: "float | np.ndarray") -> np.ndarray:
        with np.errstate(divide="ignore"):
            away = (np.log(damage) - math.log(self.capacity)) / self.ln_sd
        return np.asarray(log_ndtr(-away))


def equivalent_range(histogram: Histogram, slope: float) -> float:
    r"""Range of equal damage at constant amplitude, :math:`(\sum n S^m / \sum n)^{1/m}`.

    Parameters
    ----------
    histogram
        Cycles counted by range.
    slope
        Slope m of the S-N curve [1].

    Returns
    -------
    Range [unit of stress]; 0 without cycles.
    """
    counts = histogram.counts
    if not counts.sum():
        return 0.0
    return float((counts @ histogram.ranges**slope / counts.sum()) ** (1 / slope))

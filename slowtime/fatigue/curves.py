r"""S-N curves: how many cycles of a stress range a detail bears.

.. math:: N(S) = C\, S^{-m} \quad (S \ge S_k), \qquad
          N(S) = C\, S_k^{m_2 - m} S^{-m_2} \quad (S < S_k)

for ranges S, which are twice the amplitudes. The curve is the median; the scatter of lives
about it is lognormal.

References
----------
.. [1] O. H. Basquin, "The exponential law of endurance tests", Proc. ASTM 10 (1910) 625-630.
.. [2] EN 1993-1-9:2005, "Design of steel structures, fatigue", figure 7.1.
.. [3] DNV-RP-C203 (2021), "Fatigue design of offshore steel structures", 2.4.
"""

import dataclasses
import math

import numpy as np
from jaxtyping import Float

Values = Float[np.ndarray, "*any"]

EN_CHARACTERISTIC_SD = 1.645
"""Standard deviations from the median to the curve of 95 % survival, which standards give."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class SNCurve:
    """A median S-N curve in stress ranges, of one slope or two.

    Parameters
    ----------
    constant
        C, cycles times unit of stress to the power of `slope`.
    slope
        m [1].
    knee
        Range below which `lower_slope` holds [unit of stress]; 0 for none.
    lower_slope
        m2 [1]; None for one slope.
    cut_off
        Range below which no cycle does damage [unit of stress]; 0 for none.
    log10_sd
        Standard deviation of log10 of the life, from specimen to specimen [1]; DNV-RP-C203
        takes 0.20 for welded steel.

    Examples
    --------
    >>> curve = SNCurve(constant=1e12, slope=3.0)
    >>> curve.life(np.array([100.0])), curve.damage(np.array([100.0]))
    (array([1000000.]), array([1.e-06]))
    """

    constant: float
    slope: float
    knee: float = 0.0
    lower_slope: float | None = None
    cut_off: float = 0.0
    log10_sd: float = 0.2

    def __post_init__(self) -> None:
        for name in ("constant", "slope"):
            _positive(name, getattr(self, name))
        for name in ("knee", "cut_off", "log10_sd"):
            value = getattr(self, name)
            if not 0 <= value < math.inf:
                raise ValueError(f"{name}={value} is not allowed. Give 0 or a positive number.")
        if (self.lower_slope is None) != (self.knee == 0):
            raise ValueError(
                f"knee={self.knee} and lower_slope={self.lower_slope} belong together. Give "
                "both for two slopes, neither for one."
            )
        if self.lower_slope is not None:
            _positive("lower_slope", self.lower_slope)

    @classmethod
    def of_detail_category(
        cls, category: float, *, log10_sd: float = 0.2, characteristic: bool = False
    ) -> "SNCurve":
        """Make the curve of a detail category of EN 1993-1-9, for stress in MPa.

        Parameters
        ----------
        category
            Range of 2 million cycles at 95 % survival [MPa], such as 71.
        log10_sd
            Standard deviation of log10 of the life [1].
        characteristic
            Whether to keep the curve of 95 % survival; otherwise the median, which is
            ``10**(1.645 log10_sd)`` times as long.
        """
        _positive("category", category)
        shift = 1.0 if characteristic else 10 ** (EN_CHARACTERISTIC_SD * log10_sd)
        knee = category * (2.0 / 5.0) ** (1 / 3)
        return cls(
            constant=shift * 2e6 * category**3,
            slope=3.0,
            knee=knee,
            lower_slope=5.0,
            cut_off=knee * (5e6 / 1e8) ** (1 / 5),
            log10_sd=log10_sd,
        )

    def damage(self, ranges: Values) -> Values:
        """Damage of one cycle of each range, 1 / N.

        Parameters
        ----------
        ranges
            Stress ranges [unit of stress].

        Returns
        -------
        Damage [1]; 0 below the cut-off.
        """
        with np.errstate(over="ignore", under="ignore"):
            damage = ranges**self.slope / self.constant
            if self.lower_slope is not None:
                knee = self.knee**self.slope / self.constant
                below = knee * (ranges / self.knee) ** self.lower_slope
                damage = np.where(ranges < self.knee, below, damage)
        return np.asarray(np.where(ranges < self.cut_off, 0.0, damage))

    def life(self, ranges: Values) -> Values:
        """Compute the number of cycles of each range that the median specimen bears.

        Parameters
        ----------
        ranges
            Stress ranges [unit of stress].

        Returns
        -------
        Cycles [1]; infinite below the cut-off.
        """
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / self.damage(ranges))

    def slopes(self, ranges: Values) -> Values:
        """Slope of the curve at each range [1].

        Parameters
        ----------
        ranges
            Stress ranges [unit of stress].
        """
        lower = self.slope if self.lower_slope is None else self.lower_slope
        return np.asarray(np.where(ranges < self.knee, lower, self.slope))

    @property
    def ln_sd(self) -> float:
        """Standard deviation of the natural logarithm of the life [1]."""
        return self.log10_sd * math.log(10)


def _positive(name: str, value: float) -> None:
    if not 0 < value < math.inf:
        raise ValueError(f"{name}={value} is not allowed. Give a positive number.")

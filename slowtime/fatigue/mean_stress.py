r"""Mean stress: the range about zero that does the same damage as a range about a mean.

.. math:: \text{Goodman: } \frac{S}{1 - \sigma_m / \sigma_u}, \qquad
          \text{Gerber: } \frac{S}{1 - (\sigma_m / \sigma_u)^2}

with the mean :math:`\sigma_m` and the tensile strength :math:`\sigma_u`. Means in compression
count as 0, which is on the safe side.

References
----------
.. [1] J. Goodman, "Mechanics applied to engineering", Longmans (1899).
.. [2] N. E. Dowling, "Mean stress effects in stress-life and strain-life fatigue", SAE paper
   2004-01-2227 (2004).
"""

import dataclasses
from typing import Literal

import numpy as np

from .cycles import Cycles

Rule = Literal["none", "goodman", "gerber"]
MOST = 0.95
"""Share of the strength to which a mean is counted [1]. At 1 both rules ask for an infinite
range; a peak there is a failure by strength, not by fatigue."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class MeanStress:
    """How means are taken into account.

    Parameters
    ----------
    rule
        ``"none"``, ``"goodman"`` or ``"gerber"``.
    strength
        Tensile strength, in the unit of the stress; None with ``"none"``.
    constant_mean
        Stress at rest, such as of dead load, which the samples lack; in the same unit.

    Examples
    --------
    >>> one = Cycles(np.array([100.0]), np.array([200.0]), np.ones(1))
    >>> MeanStress(rule="goodman", strength=400.0).corrected(one).ranges
    array([200.])
    """

    rule: Rule = "none"
    strength: float | None = None
    constant_mean: float = 0.0

    def __post_init__(self) -> None:
        if self.rule not in ("none", "goodman", "gerber"):
            raise ValueError(
                f"rule={self.rule!r} is not known. Allowed: none, goodman, gerber."
            )
        if self.rule != "none" and (self.strength is None or not self.strength > 0):
            raise ValueError(
                f"{self.rule} with strength={self.strength}: give the tensile strength, in the "
                "unit of the stress."
            )

    def corrected(self, cycles: Cycles) -> Cycles:
        """Replace each range by the one about zero that does the same damage."""
        if self.rule == "none" or self.strength is None:
            return cycles
        share = np.clip((cycles.means + self.constant_mean) / self.strength, 0.0, MOST)
        power = 1 if self.rule == "goodman" else 2
        return cycles._replace(
            ranges=cycles.ranges / (1 - share**power), means=np.zeros_like(cycles.means)
        )

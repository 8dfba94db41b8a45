r"""Mean and standard deviation of the objective over the random inputs.

Both are averages over the same quasi-random points of the inputs for every design, so that the
difference of two designs carries no sampling noise and a smooth objective stays smooth.
"""

import dataclasses

import numpy as np
import scipy
from jaxtyping import Float
from scipy.special import ndtri

from .problem import DesignProblem, values_of

POINTS = 1024
"""Scrambled Sobol points of the inputs: a power of two. The standard deviation of a linear
objective of five normal inputs is then right to 0.5 %."""

COARSE = 128
"""Likewise of the first search from many starts, whose result is refined with `POINTS`."""

SPREAD_FLOOR = 1e-9
"""Standard deviation over the mean's size, below which an objective counts as certain."""


@dataclasses.dataclass(frozen=True, slots=True)
class Moments:
    """Mean and standard deviation of the objective at designs [design]."""

    mean: Float[np.ndarray, " design"]
    sd: Float[np.ndarray, " design"]


class RobustObjective:
    r"""The objective of eq. (4.18): :math:`\alpha\,\mu/\mu^* + (1-\alpha)\,\sigma/\sigma^*`.

    Parameters
    ----------
    problem
        Whose objective it is.
    seed
        Of the scrambling of the points.
    reference
        :math:`\mu^*` and :math:`\sigma^*`; by default the absolute mean and the standard
        deviation at the design to compare with.
    points
        Of the inputs: a power of two.

    Notes
    -----
    The book divides by nothing and so adds quantities of one unit only where
    :math:`\alpha` is read with the units in mind; its text says variance where its formula
    takes the standard deviation. The references make :math:`\alpha` a weight of relative
    changes.
    """

    def __init__(
        self,
        problem: DesignProblem,
        seed: int,
        reference: tuple[float, float] | None = None,
        points: int = POINTS,
    ) -> None:
        self.problem = problem
        sobol = scipy.stats.qmc.Sobol(problem.inputs.size, rng=np.random.default_rng(seed))
        unit = np.clip(sobol.random(points), 1e-12, 1.0 - 1e-12)
        self._x = problem.inputs.physical(np.asarray(ndtri(unit)))
        if reference is None:
            at = self.moments(problem.begin[None])
            reference = abs(float(at.mean[0])), float(at.sd[0])
        mean, sd = reference
        certain = sd <= SPREAD_FLOOR * max(abs(mean), np.finfo(float).tiny)
        if certain and problem.alpha < 1.0 and not problem.alpha > 0.0:
            raise ValueError(
                "The objective does not vary over the inputs at the starting design, and alpha "
                "is 0. Give alpha above 0, or an objective that depends on the inputs."
            )
        self.reference = (mean or 1.0, 1.0 if certain else sd)

    def moments(self, designs: Float[np.ndarray, "design variable"]) -> Moments:
        """Mean and standard deviation of the objective at each design.

        Parameters
        ----------
        designs
            Design variables, in their units.

        Returns
        -------
        Both moments, in the unit of the objective.
        """
        count = len(self._x)
        d = np.repeat(designs, count, axis=0)
        x = np.tile(self._x, (len(designs), 1))
        values = values_of(self.problem.objective, d, x, "The objective")
        each = values.reshape(len(designs), count)
        mean, sd = each.mean(axis=1), each.std(axis=1, ddof=1)
        return Moments(mean, np.where(sd > SPREAD_FLOOR * np.abs(mean), sd, 0.0))

    def __call__(
        self, designs: Float[np.ndarray, "design variable"]
    ) -> Float[np.ndarray, " design"]:
        """Value at each design."""
        found = self.moments(designs)
        mean, sd = self.reference
        alpha = self.problem.alpha
        return np.asarray(alpha * found.mean / mean + (1.0 - alpha) * found.sd / sd)

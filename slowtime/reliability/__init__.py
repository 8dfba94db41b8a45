"""A limit state in; the probability that it is passed, with how well that is known, out.

Limit states are functions of independent standard normal inputs [sample input], negative where
the structure fails; `physical` makes such a function of one of physical inputs.
"""

from .design_point import DesignPoint, design_points
from .probability import Probability, physical
from .sampling import directional, importance, monte_carlo
from .subset import subset_simulation

__all__ = [
    "DesignPoint",
    "Probability",
    "design_points",
    "directional",
    "importance",
    "monte_carlo",
    "physical",
    "subset_simulation",
]

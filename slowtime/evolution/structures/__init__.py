"""Frequencies and shapes of many modes in; what stiffness and mass changed, how much, out.

What the data cannot tell is said in words, with what would tell it.
"""

from .experiments import Remedy as Remedy
from .experiments import what_would_tell as what_would_tell
from .fit import Optimum as Optimum
from .fit import Posterior as Posterior
from .fit import estimate as estimate
from .hypotheses import Hypothesis, Named, name_changes
from .identifiability import Limit, what_cannot_be_told
from .measured_modes import MeasuredModes
from .parametric_structure import ParametricStructure

__all__ = [
    "Hypothesis",
    "Limit",
    "MeasuredModes",
    "Named",
    "Optimum",
    "ParametricStructure",
    "Posterior",
    "Remedy",
    "estimate",
    "name_changes",
    "what_cannot_be_told",
    "what_would_tell",
]

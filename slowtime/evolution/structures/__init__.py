"""Frequencies and shapes of many modes in; what stiffness and mass changed, how much, out.

What the data cannot tell is said in words, with what would tell it.
"""

from .experiments import Remedy, propose_measurements
from .fit import Optimum, StructurePosterior, estimate
from .hypotheses import Hypothesis, NamedChanges, name_changes
from .identifiability import Limit, identifiability_limits
from .measured_modes import MeasuredModes
from .parametric_structure import ParametricStructure
from .updatable_models import ReducedStructure, SparseStructure, UpdatableModel

__all__ = [
    "Hypothesis",
    "Limit",
    "MeasuredModes",
    "NamedChanges",
    "Optimum",
    "ParametricStructure",
    "ReducedStructure",
    "Remedy",
    "SparseStructure",
    "StructurePosterior",
    "UpdatableModel",
    "estimate",
    "identifiability_limits",
    "name_changes",
    "propose_measurements",
]

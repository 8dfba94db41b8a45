"""Frequencies and shapes of many modes in; what stiffness and mass changed, how much, out.

What the data cannot tell is said in words, with what would tell it.
"""

from .experiments import Remedy, propose_measurements
from .fit import Optimum, StructurePosterior, estimate
from .hypotheses import ChangedParts, NamedChanges, name_changes
from .identifiability import IdentifiabilityLimit, identifiability_limits
from .measured_modes import MeasuredModes
from .parametric_structure import ParametricStructure
from .sensor_placement import (
    Criterion,
    ModePrecision,
    Placement,
    PlacementProblem,
    place_sensors,
)
from .shape_scatter import ShapeScatter, estimate_with_scatter, shape_scatter
from .updatable_models import (
    ReducedStructure,
    SparseStructure,
    UpdatableModel,
    updatable_model,
)

__all__ = [
    "ChangedParts",
    "Criterion",
    "IdentifiabilityLimit",
    "MeasuredModes",
    "ModePrecision",
    "NamedChanges",
    "Optimum",
    "ParametricStructure",
    "Placement",
    "PlacementProblem",
    "ReducedStructure",
    "Remedy",
    "ShapeScatter",
    "SparseStructure",
    "StructurePosterior",
    "UpdatableModel",
    "estimate",
    "estimate_with_scatter",
    "identifiability_limits",
    "name_changes",
    "place_sensors",
    "propose_measurements",
    "shape_scatter",
    "updatable_model",
]

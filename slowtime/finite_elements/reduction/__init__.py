"""Sparse parametric matrices in; a small dense model that holds over the parameters out."""

from .adaptive_model import AdaptiveModel
from .basis import parametric_basis
from .candidates import BasisSettings
from .craig_bampton import craig_bampton
from .modal import reduce_modal, settings_for_band
from .physical import reduce_to_physical
from .reduced_model import ReducedModel, ReductionError, project
from .verification import verify

__all__ = [
    "AdaptiveModel",
    "BasisSettings",
    "ReducedModel",
    "ReductionError",
    "craig_bampton",
    "parametric_basis",
    "project",
    "reduce_modal",
    "reduce_to_physical",
    "settings_for_band",
    "verify",
]

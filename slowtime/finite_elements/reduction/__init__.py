"""Sparse parametric matrices in; a small dense model that holds over the parameters out."""

from .basis import BasisSettings, parametric_basis
from .craig_bampton import craig_bampton
from .modal import reduce_modal
from .reduced_model import ReducedModel, ReductionError, project
from .verification import verify

__all__ = [
    "BasisSettings",
    "ReducedModel",
    "ReductionError",
    "craig_bampton",
    "parametric_basis",
    "project",
    "reduce_modal",
    "verify",
]

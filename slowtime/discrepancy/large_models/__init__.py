"""Large model and records in, a model of the few modes that the records show out."""

from .diagnosis import (
    enlarge,
    fit_constants,
    is_large,
    reasons_against,
    reduce_for,
    reduce_plainly,
)
from .reduction import ReducedModel

__all__ = [
    "ReducedModel",
    "enlarge",
    "fit_constants",
    "is_large",
    "reasons_against",
    "reduce_for",
    "reduce_plainly",
]

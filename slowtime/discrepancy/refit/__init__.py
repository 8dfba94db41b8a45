"""A plant and records in; the constants that explain them best, and what is left, out."""

from .fit import Fit, refit
from .pieces import begun_by, first_swings, loudest, pieces, shot, slowest_hz
from .prior import UNCLAIMED, Prior, prior_of
from .solve import WRONG, GivenUp
from .starts import size_of, state_from_many, state_heard
from .weights import Weights, weights_of

__all__ = [
    "UNCLAIMED",
    "WRONG",
    "Fit",
    "GivenUp",
    "Prior",
    "Weights",
    "begun_by",
    "first_swings",
    "loudest",
    "pieces",
    "prior_of",
    "refit",
    "shot",
    "size_of",
    "slowest_hz",
    "state_from_many",
    "state_heard",
    "weights_of",
]

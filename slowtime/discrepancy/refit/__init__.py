"""A plant and records in; the constants that explain them best, and what is left, out."""

from .fit import Fit, refit
from .pieces import pieces, shot, slowest_hz
from .prior import UNCLAIMED, Prior, prior_of
from .solve import WRONG, GivenUp
from .weights import Weights, weights_of

__all__ = [
    "UNCLAIMED",
    "WRONG",
    "Fit",
    "GivenUp",
    "Prior",
    "Weights",
    "pieces",
    "prior_of",
    "refit",
    "shot",
    "slowest_hz",
    "weights_of",
]

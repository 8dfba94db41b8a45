"""A plant and records in; the constants that explain them best, and what is left, out."""

from .fit import Fit, refit, try_refit
from .initial_states import size_of, state_from_many, state_heard
from .levenberg_marquardt import WRONG, GivenUp
from .multiple_shooting import begun_by, first_swings, loudest, pieces, shooting_fit, slowest_hz
from .prior import UNCLAIMED, Prior, prior_of
from .spectral_weights import Weights, weights_of

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
    "shooting_fit",
    "size_of",
    "slowest_hz",
    "state_from_many",
    "state_heard",
    "try_refit",
    "weights_of",
]

"""Readings of a degradation in, laws weighed by evidence and remaining life out."""

from slowtime.evolution.life.remaining_life import RemainingLife

from .curve_posterior import CurveLaw
from .curves import Curve
from .fleet import FleetPrior, pooled
from .gaussian import GaussianLaw
from .history import Event
from .law import Drawn, Law, Posterior
from .mixture import BOUND, Mixture, learn
from .registry import STANDARD

__all__ = [
    "BOUND",
    "STANDARD",
    "Curve",
    "CurveLaw",
    "Drawn",
    "Event",
    "FleetPrior",
    "GaussianLaw",
    "Law",
    "Mixture",
    "Posterior",
    "RemainingLife",
    "learn",
    "pooled",
]

"""Readings of a degradation in, laws weighed by evidence and remaining life out."""

import warnings
from typing import Any

from slowtime.evolution.life.remaining_life import RemainingLife

from .curve_posterior import CurveLaw
from .curves import Curve
from .fleet import FleetPrior, pooled
from .gaussian import GaussianLaw
from .history import KnownChange
from .law import DegradationLaw, Drawn, Posterior
from .mixture import BOUND, Mixture, learn
from .registry import STANDARD

__all__ = [
    "BOUND",
    "STANDARD",
    "Curve",
    "CurveLaw",
    "DegradationLaw",
    "Drawn",
    "FleetPrior",
    "GaussianLaw",
    "KnownChange",
    "Mixture",
    "Posterior",
    "RemainingLife",
    "learn",
    "pooled",
]

_FORMER = {"Law": DegradationLaw, "Event": KnownChange}


def __getattr__(name: str) -> Any:
    """Give what has another name now, with a warning."""
    if name not in _FORMER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = _FORMER[name]
    warnings.warn(
        f"slowtime.degradation.{name} is called {found.__name__} now.",
        DeprecationWarning,
        stacklevel=2,
    )
    return found

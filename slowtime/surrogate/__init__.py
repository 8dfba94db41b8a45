"""A few runs of something slow in; a quick function with a standard deviation out.

Estimators come on first use: they follow scikit-learn, which is heavy, and which a process that
needs no surrogate does without.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .chaos import PolynomialChaos
    from .gaussian import GaussianProcess
    from .hybrid import HybridExpansion

from .homotopy import homotopy
from .notices import (
    ExtrapolationWarning,
    FewPointsWarning,
    IllConditionedWarning,
    NothingLearntWarning,
    SurrogateWarning,
)

_ROOMS = {
    "GaussianProcess": "gaussian",
    "HybridExpansion": "hybrid",
    "PolynomialChaos": "chaos",
}

__all__ = [
    "ExtrapolationWarning",
    "FewPointsWarning",
    "GaussianProcess",
    "HybridExpansion",
    "IllConditionedWarning",
    "NothingLearntWarning",
    "PolynomialChaos",
    "SurrogateWarning",
    "homotopy",
]


def __getattr__(name: str) -> Any:
    if name not in _ROOMS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_ROOMS[name]}", __name__), name)

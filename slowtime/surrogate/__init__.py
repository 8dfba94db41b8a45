"""A few runs of something slow in; a quick function with a standard deviation out.

Estimators come on first use: they follow scikit-learn, which is heavy, and which a process that
needs no surrogate does without.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .anova import GeneralisedAnova
    from .chaos import PolynomialChaos
    from .choice import Choice, choose
    from .gaussian import GaussianProcess
    from .hybrid import HybridExpansion
    from .interface import Surrogate
    from .networks import NetworkEnsemble
    from .plain import PlainProcess
    from .support import SupportVectors

from .homotopy import homotopy
from .notices import (
    ExtrapolationWarning,
    FewPointsWarning,
    IllConditionedWarning,
    NothingLearntWarning,
    SurrogateWarning,
)

_ROOMS = {
    "Choice": "choice",
    "GaussianProcess": "gaussian",
    "GeneralisedAnova": "anova",
    "HybridExpansion": "hybrid",
    "NetworkEnsemble": "networks",
    "PlainProcess": "plain",
    "PolynomialChaos": "chaos",
    "SupportVectors": "support",
    "Surrogate": "interface",
    "choose": "choice",
}

__all__ = [
    "Choice",
    "ExtrapolationWarning",
    "FewPointsWarning",
    "GaussianProcess",
    "GeneralisedAnova",
    "HybridExpansion",
    "IllConditionedWarning",
    "NetworkEnsemble",
    "NothingLearntWarning",
    "PlainProcess",
    "PolynomialChaos",
    "SupportVectors",
    "Surrogate",
    "SurrogateWarning",
    "choose",
    "homotopy",
]


def __getattr__(name: str) -> Any:
    if name not in _ROOMS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_ROOMS[name]}", __name__), name)

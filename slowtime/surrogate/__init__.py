"""A few runs of something slow in; a quick function with a standard deviation out.

Estimators come on first use: they follow scikit-learn, which is heavy, and which a process that
needs no surrogate does without.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .choice import Choice, choose
    from .gaussian_processes.anova import GeneralisedAnova
    from .gaussian_processes.gaussian_process import GaussianProcess
    from .gaussian_processes.hybrid_expansion import HybridExpansion
    from .gaussian_processes.scikit_process import PlainProcess
    from .interface import Surrogate
    from .networks import NetworkEnsemble
    from .polynomial_chaos import PolynomialChaos
    from .support_vectors import SupportVectors

from .homotopy import homotopy
from .surrogate_warnings import (
    ExtrapolationWarning,
    FewPointsWarning,
    IllConditionedWarning,
    NothingLearntWarning,
    SurrogateWarning,
)

_MODULE_OF = {
    "Choice": "choice",
    "GaussianProcess": "gaussian_processes.gaussian_process",
    "GeneralisedAnova": "gaussian_processes.anova",
    "HybridExpansion": "gaussian_processes.hybrid_expansion",
    "NetworkEnsemble": "networks",
    "PlainProcess": "gaussian_processes.scikit_process",
    "PolynomialChaos": "polynomial_chaos",
    "SupportVectors": "support_vectors",
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
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_MODULE_OF[name]}", __name__), name)

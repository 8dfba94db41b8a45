"""A limit state of random inputs in; its probability of failure, with its error, out.

A `Problem` holds named inputs with marginal distributions, their dependence, and a limit state
g, which fails where g is at most 0. Each method of `METHODS` takes it and returns a `Result`.
"""

from .design_points.first_order import form, mean_value
from .design_points.outcrossing import Outcrossing, outcrossing
from .design_points.search import DesignPointSearch, Search, find_design_points
from .design_points.second_order import sorm
from .design_points.system import ditlevsen, system
from .methods import METHODS, Method, estimate
from .problem import Conditional, Evaluator, LimitState, Problem, System, correlated, unknowns
from .random_inputs.copulas import (
    ClaytonCopula,
    Copula,
    FrankCopula,
    GaussianCopula,
    GumbelCopula,
    StudentCopula,
)
from .random_inputs.marginals import FAMILIES, Marginal, marginal
from .result import DesignPoint, Result, Stopping
from .sampling.active_learning import active_learning
from .sampling.cross_entropy import cross_entropy
from .sampling.directional import directional
from .sampling.importance import importance
from .sampling.monte_carlo import monte_carlo
from .sampling.stratified import stratified
from .sampling.subset import subset_simulation

__all__ = [
    "FAMILIES",
    "METHODS",
    "ClaytonCopula",
    "Conditional",
    "Copula",
    "DesignPoint",
    "DesignPointSearch",
    "Evaluator",
    "FrankCopula",
    "GaussianCopula",
    "GumbelCopula",
    "LimitState",
    "Marginal",
    "Method",
    "Outcrossing",
    "Problem",
    "Result",
    "Search",
    "Stopping",
    "StudentCopula",
    "System",
    "active_learning",
    "correlated",
    "cross_entropy",
    "directional",
    "ditlevsen",
    "estimate",
    "find_design_points",
    "form",
    "importance",
    "marginal",
    "mean_value",
    "monte_carlo",
    "outcrossing",
    "sorm",
    "stratified",
    "subset_simulation",
    "system",
    "unknowns",
]

"""A limit state of random inputs in; its probability of failure, with its error, out.

A `Problem` holds named inputs with marginal distributions, their dependence, and a limit state
g, which fails where g is at most 0. Each method of `METHODS` takes it and returns a `Result`.
"""

from .active import active_learning
from .copulas import (
    ClaytonCopula,
    Copula,
    FrankCopula,
    GaussianCopula,
    GumbelCopula,
    StudentCopula,
)
from .cross_entropy import cross_entropy
from .directional import directional
from .family import METHODS, Method, estimate
from .first_order import form, mean_value
from .importance import importance
from .marginals import FAMILIES, Marginal, marginal
from .monte_carlo import monte_carlo
from .outcrossing import Outcrossing, outcrossing
from .problem import Conditional, Evaluator, LimitState, Problem, System, correlated, unknowns
from .result import DesignPoint, Result, Stopping
from .search import Found, Search, find_design_points
from .second_order import sorm
from .stratified import stratified
from .subset import subset_simulation
from .system import ditlevsen, system

__all__ = [
    "FAMILIES",
    "METHODS",
    "ClaytonCopula",
    "Conditional",
    "Copula",
    "DesignPoint",
    "Evaluator",
    "Found",
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

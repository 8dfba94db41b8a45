"""Futures of an asset and costs in; what to do, by when, and what more data is worth, out."""

from .comparison import BreakEven, Ranking, rank
from .costs import ITEMS, Cost, Costs
from .ensemble import Ensemble, from_paths
from .information import Information, linear_loss, value_of_information
from .lead_times import Access, LastOrder
from .lookahead import Lookahead, look_ahead
from .markov import (
    BeliefSolution,
    MarkovDecisionProcess,
    Solution,
    solve_beliefs,
    value_iteration,
)
from .observations import Observation, Worth
from .option import Option
from .plan import Plan, Terms, make_plan
from .renewal import AgePolicy, age_policy
from .rules import EstimateError

__all__ = [
    "ITEMS",
    "Access",
    "AgePolicy",
    "BeliefSolution",
    "BreakEven",
    "Cost",
    "Costs",
    "Ensemble",
    "EstimateError",
    "Information",
    "LastOrder",
    "Lookahead",
    "MarkovDecisionProcess",
    "Observation",
    "Option",
    "Plan",
    "Ranking",
    "Solution",
    "Terms",
    "Worth",
    "age_policy",
    "from_paths",
    "linear_loss",
    "look_ahead",
    "make_plan",
    "rank",
    "solve_beliefs",
    "value_iteration",
    "value_of_information",
]

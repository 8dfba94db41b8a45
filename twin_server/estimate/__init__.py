"""Second stage of the twin: features in order in; states with intervals and notices out."""

from .checkpoint import Checkpoint, Twin
from .covariates.words import normal_of
from .estimator import Estimated, estimate
from .foresight import (
    Foresight,
    Outlooks,
    Past,
    Prospect,
    follow,
    foresee,
    foresee_from,
    learn,
    now_of,
    past_of,
    past_of_elements,
    prospect_of,
)
from .lookout import Noticed, Series
from .notices import Notice
from .plan_answer import planned, refusal_of
from .planning import NotPlannableError, PlanOrder
from .risk import RiskOrder, assessed
from .today import Today, UnknownTodayError, today_of
from .whatif import OrderError, Simulated, check, simulate

__all__ = [
    "Checkpoint",
    "Estimated",
    "Foresight",
    "NotPlannableError",
    "Notice",
    "Noticed",
    "OrderError",
    "Outlooks",
    "Past",
    "PlanOrder",
    "Prospect",
    "RiskOrder",
    "Series",
    "Simulated",
    "Today",
    "Twin",
    "UnknownTodayError",
    "assessed",
    "check",
    "estimate",
    "follow",
    "foresee",
    "foresee_from",
    "learn",
    "normal_of",
    "now_of",
    "past_of",
    "past_of_elements",
    "planned",
    "prospect_of",
    "refusal_of",
    "simulate",
    "today_of",
]

"""Second stage of the twin: features in order in; states with intervals and notices out."""

from .change_detection import Noticed, Series
from .checkpoint import Checkpoint, Twin
from .covariates.messages import normal_of
from .estimator import Estimated, estimate
from .forecast.changes import (
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
from .notices import Notice
from .plans.answer import planned, refusal_of
from .plans.plan import NotPlannableError, PlanOrder
from .response.current_structure import Today, UnknownTodayError, today_of
from .response.simulation import OrderError, Simulated, check, simulate
from .risk import RiskOrder, assessed

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

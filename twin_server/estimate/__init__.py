"""Second stage of the twin: features in order in; states with intervals and notices out."""

from .change_detection import DetectedChange, Detector
from .checkpoint import Checkpoint, Twin
from .covariates.messages import normal_of
from .estimator import Estimates, estimate
from .forecast.changes import (
    ChangeForecast,
    ForecastState,
    LearntLaws,
    Past,
    advance,
    current_changes,
    forecast_changes,
    forecast_from_state,
    forecast_state_of,
    learn,
    past_of,
    past_of_elements,
)
from .notices import Notice
from .plans.answer import plan_answer, refusal_of
from .plans.plan import NotPlannableError, PlanOrder
from .response.current_structure import (
    CurrentStructure,
    UnknownStructureError,
    current_structure_of,
)
from .response.simulation import OrderError, Simulated, check, simulate
from .risk import RiskOrder, risk_answer

__all__ = [
    "ChangeForecast",
    "Checkpoint",
    "CurrentStructure",
    "DetectedChange",
    "Detector",
    "Estimates",
    "ForecastState",
    "LearntLaws",
    "NotPlannableError",
    "Notice",
    "OrderError",
    "Past",
    "PlanOrder",
    "RiskOrder",
    "Simulated",
    "Twin",
    "UnknownStructureError",
    "advance",
    "check",
    "current_changes",
    "current_structure_of",
    "estimate",
    "forecast_changes",
    "forecast_from_state",
    "forecast_state_of",
    "learn",
    "normal_of",
    "past_of",
    "past_of_elements",
    "plan_answer",
    "refusal_of",
    "risk_answer",
    "simulate",
]

"""A twin server's REST as typed Python: questions in, answers with uncertainty out.

from slowtime_services.client import Client

with Client("http://127.0.0.1:8000") as client:
    for twin in client.twins():
        print(twin.id, twin.stiffness_change)
"""

from .answers import (
    AssetEvent,
    AssetEvents,
    Band,
    Bands,
    Crossing,
    Digest,
    Event,
    FleetAsset,
    FleetPlan,
    Forecast,
    ForecastPoint,
    History,
    MaintenancePlan,
    PlanInformation,
    PlanOption,
    Question,
    ReliabilityClass,
    Risk,
    State,
    TrackRecord,
    Twin,
)
from .client import Client, Live
from .composite_answers import Composite, CompositeBrief, Pool
from .http import AnswerError, UnreachableError

__all__ = [
    "AnswerError",
    "AssetEvent",
    "AssetEvents",
    "Band",
    "Bands",
    "Client",
    "Composite",
    "CompositeBrief",
    "Crossing",
    "Digest",
    "Event",
    "FleetAsset",
    "FleetPlan",
    "Forecast",
    "ForecastPoint",
    "History",
    "Live",
    "MaintenancePlan",
    "PlanInformation",
    "PlanOption",
    "Pool",
    "Question",
    "ReliabilityClass",
    "Risk",
    "State",
    "TrackRecord",
    "Twin",
    "UnreachableError",
]

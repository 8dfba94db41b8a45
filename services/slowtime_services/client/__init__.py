"""A twin server's REST as typed Python: questions in, answers with uncertainty out.

from slowtime_services.client import Client

with Client("http://127.0.0.1:8000") as client:
    for twin in client.twins():
        print(twin.id, twin.stiffness_change)
"""

from slowtime_schemas.answers.asset_events import AssetEventList as AssetEvents
from slowtime_schemas.answers.asset_events import AssetEventModel as AssetEvent
from slowtime_schemas.answers.asset_events import QuestionModel as Question
from slowtime_schemas.answers.composites import CompositeBrief
from slowtime_schemas.answers.composites import CompositeModel as Composite
from slowtime_schemas.answers.composites import PoolModel as Pool
from slowtime_schemas.answers.forecasts import CrossingModel as Crossing
from slowtime_schemas.answers.forecasts import ForecastModel as Forecast
from slowtime_schemas.answers.forecasts import ForecastPoint, ReliabilityClass
from slowtime_schemas.answers.forecasts import TrackRecordModel as TrackRecord
from slowtime_schemas.answers.history import BandModel as Band
from slowtime_schemas.answers.history import BandsModel as Bands
from slowtime_schemas.answers.history import EventModel as Event
from slowtime_schemas.answers.history import HashModel as Digest
from slowtime_schemas.answers.plans import FleetAsset, PlanInformation, PlanOption
from slowtime_schemas.answers.plans import FleetPlanModel as FleetPlan
from slowtime_schemas.answers.plans import PlanModel as MaintenancePlan
from slowtime_schemas.answers.risks import RiskModel as Risk
from slowtime_schemas.answers.twins import RegisteredTwin as Twin
from slowtime_schemas.answers.twins import State

from .client import Client, Live
from .history import TwinHistory
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
    "TwinHistory",
    "UnreachableError",
]

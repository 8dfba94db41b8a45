"""The order of the stages, and the one thread that keeps it: samples in, history out."""

from .alarms import Alarms, Bell
from .asset_events import AssetEvents, orders_in
from .composites import Compositions
from .diagnoses.orders import Orders
from .feature_traces import Tracing
from .ingestion.pipeline import Pipeline
from .ingestion.updates import Listener, News
from .knowledge import Herald, TwinKnowledge
from .monitoring.model_changes import Lookout
from .recordings import Recordings
from .workers.processes import Here, Processes, Workers

__all__ = [
    "Alarms",
    "AssetEvents",
    "Bell",
    "Compositions",
    "Herald",
    "Here",
    "Listener",
    "Lookout",
    "News",
    "Orders",
    "Pipeline",
    "Processes",
    "Recordings",
    "Tracing",
    "TwinKnowledge",
    "Workers",
    "orders_in",
]

"""The order of the stages, and the one thread that keeps it: samples in, history out."""

from .alarms import Alarms, NotifierTrigger
from .asset_events import AssetEvents
from .composites import CompositeRegistry
from .diagnoses.orders import Diagnoses
from .feature_traces import FeatureTraces
from .ingestion.pipeline import Pipeline
from .ingestion.updates import TwinUpdate, UpdateListener
from .knowledge import LiveUpdates, TwinKnowledge
from .monitoring.model_changes import ModelChangeMonitor
from .quarantine import QuarantineDesk
from .recordings import Recordings
from .twin_changes import ChangeHistory
from .workers.processes import CallerThread, WorkerPool, WorkerProcesses

__all__ = [
    "Alarms",
    "AssetEvents",
    "CallerThread",
    "ChangeHistory",
    "CompositeRegistry",
    "Diagnoses",
    "FeatureTraces",
    "LiveUpdates",
    "ModelChangeMonitor",
    "NotifierTrigger",
    "Pipeline",
    "QuarantineDesk",
    "Recordings",
    "TwinKnowledge",
    "TwinUpdate",
    "UpdateListener",
    "WorkerPool",
    "WorkerProcesses",
]

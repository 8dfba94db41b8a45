"""First stage of the twin: whatever arrives in; features in order out, none missing unseen."""

from .account import Account
from .backfill import Backfill
from .changes import (
    DoubtedSequence,
    LostRange,
    OldReading,
    Ordered,
    ReachedLimit,
    RepeatedFeatures,
    RivalAgents,
    StoreChange,
)
from .held import Arrival
from .reception import Received, Reception
from .refusals import Refusals
from .rivals import contest_reading
from .runs import EdgeQuery, Holding, Run
from .sensors import SensorNotice, SensorWatch
from .sequence import DAMAGED

__all__ = [
    "DAMAGED",
    "Account",
    "Arrival",
    "Backfill",
    "DoubtedSequence",
    "EdgeQuery",
    "Holding",
    "LostRange",
    "OldReading",
    "Ordered",
    "ReachedLimit",
    "Received",
    "Reception",
    "Refusals",
    "RepeatedFeatures",
    "RivalAgents",
    "Run",
    "SensorNotice",
    "SensorWatch",
    "StoreChange",
    "contest_reading",
]

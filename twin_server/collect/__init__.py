"""First stage of the twin: whatever arrives in; features in order out, none missing unseen."""

from .account import Account
from .backfill import Backfill
from .reception import Received, Reception
from .refusals import Refusals
from .rivals import contest_reading
from .runs import (
    Arrival,
    Change,
    EdgeQuery,
    Holding,
    LostRange,
    OldReading,
    Ordered,
    RepeatedFeatures,
    RivalAgents,
    Run,
)
from .sensors import SensorNotice, SensorWatch
from .sequence import DAMAGED

__all__ = [
    "DAMAGED",
    "Account",
    "Arrival",
    "Backfill",
    "Change",
    "EdgeQuery",
    "Holding",
    "LostRange",
    "OldReading",
    "Ordered",
    "Received",
    "Reception",
    "Refusals",
    "RepeatedFeatures",
    "RivalAgents",
    "Run",
    "SensorNotice",
    "SensorWatch",
    "contest_reading",
]

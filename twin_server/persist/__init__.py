"""Third stage of the twin: what was accepted and estimated goes to disk, and is read there."""

from .diagnosing import DiagnosisRow
from .errors import DamagedStoreError, StoreError, WrongStoreError
from .sqlite import SqliteStore
from .store import (
    Cut,
    DetailRow,
    EventRow,
    FeatureRow,
    History,
    RunRow,
    StateRow,
    Store,
    TwinRow,
)

__all__ = [
    "Cut",
    "DamagedStoreError",
    "DetailRow",
    "DiagnosisRow",
    "EventRow",
    "FeatureRow",
    "History",
    "RunRow",
    "SqliteStore",
    "StateRow",
    "Store",
    "StoreError",
    "TwinRow",
    "WrongStoreError",
]

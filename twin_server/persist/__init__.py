"""Third stage of the twin: what was accepted and estimated goes to disk, and is read there."""

from .sqlite import SqliteStore
from .store import (
    Cut,
    EventRow,
    FeatureRow,
    History,
    RunRow,
    Store,
    StoreError,
    TwinRow,
    WrongStoreError,
)

__all__ = [
    "Cut",
    "EventRow",
    "FeatureRow",
    "History",
    "RunRow",
    "SqliteStore",
    "Store",
    "StoreError",
    "TwinRow",
    "WrongStoreError",
]

"""Third stage of the twin: what was accepted and estimated goes to disk, and is read there."""

from .auditing import Audit, audit
from .compositing import CompositeRow
from .copying import backup, restore
from .diagnosing import DiagnosisRow
from .errors import DamagedStoreError, StoreError, WrongStoreError
from .fatigue_rows import HOUR_NS, FatigueRow
from .ledgering import HeadRow
from .opening import is_url, open_store
from .postgres import PostgresStore
from .sqlite import SqliteStore, audit_file, look_through
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
    "HOUR_NS",
    "Audit",
    "CompositeRow",
    "Cut",
    "DamagedStoreError",
    "DetailRow",
    "DiagnosisRow",
    "EventRow",
    "FatigueRow",
    "FeatureRow",
    "HeadRow",
    "History",
    "PostgresStore",
    "RunRow",
    "SqliteStore",
    "StateRow",
    "Store",
    "StoreError",
    "TwinRow",
    "WrongStoreError",
    "audit",
    "audit_file",
    "backup",
    "is_url",
    "look_through",
    "open_store",
    "restore",
]

"""Third stage of the twin: accepted and estimated rows in; the durable history out."""

from twin_server.persist.tables.rows import (
    DetailRow,
    EventRow,
    FeatureRow,
    RunRow,
    StateRow,
    TwinRow,
)

from .attempts import MARKED, AttemptNote, FileNote, RowNote
from .backups import backup, restore
from .errors import DamagedStoreError, StoreError, StoreInUseError, WrongStoreError
from .factory import is_url, note_path, open_store
from .ledger_audit import Audit, audit
from .postgres import PostgresStore, audit_url, without_secret
from .sqlite import SqliteStore, audit_file, verify_file
from .store import Store, StoredHistory, WriteBatch
from .tables.composites import CompositeRow
from .tables.diagnoses import DiagnosisRow
from .tables.fatigue import HOUR_NS, FatigueRow
from .tables.ledger import HeadRow
from .tables.outlooks import OutlookRow
from .tables.quarantine import AsideRow

__all__ = [
    "HOUR_NS",
    "MARKED",
    "AsideRow",
    "AttemptNote",
    "Audit",
    "CompositeRow",
    "DamagedStoreError",
    "DetailRow",
    "DiagnosisRow",
    "EventRow",
    "FatigueRow",
    "FeatureRow",
    "FileNote",
    "HeadRow",
    "OutlookRow",
    "PostgresStore",
    "RowNote",
    "RunRow",
    "SqliteStore",
    "StateRow",
    "Store",
    "StoreError",
    "StoreInUseError",
    "StoredHistory",
    "TwinRow",
    "WriteBatch",
    "WrongStoreError",
    "audit",
    "audit_file",
    "audit_url",
    "backup",
    "is_url",
    "note_path",
    "open_store",
    "restore",
    "verify_file",
    "without_secret",
]

"""Model file and records in; the answer of a diagnosis, as files that others read, out."""

from .campaign import campaign_of
from .channel_roles import Roles, roles_of
from .document import document_of
from .report import write_report
from .results import write_results
from .run import diagnose_records
from .sources import Source, read_any

__all__ = [
    "Roles",
    "Source",
    "campaign_of",
    "diagnose_records",
    "document_of",
    "read_any",
    "roles_of",
    "write_report",
    "write_results",
]

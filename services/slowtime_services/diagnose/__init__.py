"""Model file and records in; the answer of a diagnosis, as files that others read, out."""

from .campaign import campaign_of
from .document import document_of
from .page import write_report
from .roles import Roles, roles_of
from .run import diagnose_records
from .sources import Source, read_any
from .writing import write_results

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

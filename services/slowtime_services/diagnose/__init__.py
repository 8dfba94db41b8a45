"""Model file and records in; the answer of a diagnosis, as files that others read, out."""

from .campaign import Source, campaign_of, read_any
from .document import document_of
from .roles import Roles, roles_of
from .writing import write_results

__all__ = [
    "Roles",
    "Source",
    "campaign_of",
    "document_of",
    "read_any",
    "roles_of",
    "write_results",
]

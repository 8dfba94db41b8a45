"""A model file and two modes files in; members that may have changed, and the verdict, out."""

from .entries import assessment_entry, evidence_changes, limit_entries
from .members import Members, members_of
from .states import StateErrors, planned_state, read_state, read_states

__all__ = [
    "Members",
    "StateErrors",
    "assessment_entry",
    "evidence_changes",
    "limit_entries",
    "members_of",
    "planned_state",
    "read_state",
    "read_states",
]

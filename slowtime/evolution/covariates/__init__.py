"""Frequencies, temperature and load in; what is not normal of their change, and alarms, out."""

from .basis import Basis as Basis
from .change_onset import Entered
from .change_size import Entry, entry
from .monitor import Judgement, Watch, WatchState
from .normal_model import Candidate, Normal, learn_normal

__all__ = [
    "Basis",
    "Candidate",
    "Entered",
    "Entry",
    "Judgement",
    "Normal",
    "Watch",
    "WatchState",
    "entry",
    "learn_normal",
]

"""Frequencies, temperature and load in; what is not normal of their change, and alarms, out."""

from .basis import Basis
from .change_onset import Entered
from .change_size import ChangeEstimate, estimate_change
from .monitor import Judgement, Watch, WatchState
from .normal_model import CandidateLaw, NormalModel, learn_normal

__all__ = [
    "Basis",
    "CandidateLaw",
    "ChangeEstimate",
    "Entered",
    "Judgement",
    "NormalModel",
    "Watch",
    "WatchState",
    "estimate_change",
    "learn_normal",
]

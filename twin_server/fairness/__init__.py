"""Requests of sites and tokens in; slots, turns and time of processors shared fairly out."""

from .gate import FairGate
from .holders import ALONE, Holder, acting_for, current_holder
from .processors import Processors, Turn
from .quota import Holding, OverQuotaError, Quota
from .registry import Holdings
from .usage import DecayedUsage

__all__ = [
    "ALONE",
    "DecayedUsage",
    "FairGate",
    "Holder",
    "Holding",
    "Holdings",
    "OverQuotaError",
    "Processors",
    "Quota",
    "Turn",
    "acting_for",
    "current_holder",
]

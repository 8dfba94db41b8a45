"""Requests of sites and tokens in; slots, turns and time of processors shared fairly out."""

from .gate import FairGate
from .holders import ALONE, Holder, acting_for, current_holder
from .processors import Processors, Turn, usable_processors
from .quota import ALPHA, HeldKind, OverQuotaError, Quota, QuotaHolding, may_take
from .registry import Holdings
from .usage import DecayedUsage

__all__ = [
    "ALONE",
    "ALPHA",
    "DecayedUsage",
    "FairGate",
    "HeldKind",
    "Holder",
    "Holdings",
    "OverQuotaError",
    "Processors",
    "Quota",
    "QuotaHolding",
    "Turn",
    "acting_for",
    "current_holder",
    "may_take",
    "usable_processors",
]

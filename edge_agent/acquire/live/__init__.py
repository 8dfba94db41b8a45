"""Bytes of a live sensor in; blocks with indices, times and an account of losses out."""

from .registry import SCHEMES, Opened, Scheme, Surroundings, check, importing
from .sensor import LiveSource
from .tally import COUNTERS

__all__ = [
    "COUNTERS",
    "SCHEMES",
    "LiveSource",
    "Opened",
    "Scheme",
    "Surroundings",
    "check",
    "importing",
]

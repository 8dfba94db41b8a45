"""Bytes of a live sensor in; blocks with indices, times and an account of losses out."""

from .counts import COUNTERS
from .registry import SCHEMES, Opened, Scheme, TransportContext, check, importing
from .sensor import LiveSource

__all__ = [
    "COUNTERS",
    "SCHEMES",
    "LiveSource",
    "Opened",
    "Scheme",
    "TransportContext",
    "check",
    "importing",
]

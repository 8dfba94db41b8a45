"""Message bus: one protocol, over Zenoh or within one process."""

from .background import BackgroundBus
from .inbox import Inbox
from .key_versions import TwoVersionBus
from .keys import InvalidKeyError, matches
from .memory import MemoryBus
from .partial import PartialBus
from .protocol import (
    Answers,
    Bus,
    BusClosedError,
    BusUnreachableError,
    Handle,
    Query,
    Sample,
)
from .unpacking import UnpackingBus, unpacked
from .zenoh import ZenohBus

__all__ = [
    "Answers",
    "BackgroundBus",
    "Bus",
    "BusClosedError",
    "BusUnreachableError",
    "Handle",
    "Inbox",
    "InvalidKeyError",
    "MemoryBus",
    "PartialBus",
    "Query",
    "Sample",
    "TwoVersionBus",
    "UnpackingBus",
    "ZenohBus",
    "matches",
    "unpacked",
]

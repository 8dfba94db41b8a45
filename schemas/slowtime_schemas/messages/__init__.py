"""The messages between edge and twin, each with its current version."""

from .base import Message, TimeBase
from .fatigue import (
    CurveOfMessage,
    Fatigue,
    FatiguePoint,
    NotNegative,
    Virtual,
    VirtualQuantity,
)
from .features import (
    UNIT_NORM_WITHIN,
    Components,
    Features,
    Mode,
    Quality,
    SensorSamples,
    Shape,
    Smoothed,
)
from .health import ACK_VERSION, FOREIGN_ACKS, About, Acknowledgement, Health, Link, LinkProfile
from .ledger import Accepted, Branch, LedgerUpdate, Sha256, SignedHead
from .twin import Event, Registered, SeenMode, TwinState

__all__ = [
    "ACK_VERSION",
    "FOREIGN_ACKS",
    "UNIT_NORM_WITHIN",
    "About",
    "Accepted",
    "Acknowledgement",
    "Branch",
    "Components",
    "CurveOfMessage",
    "Event",
    "Fatigue",
    "FatiguePoint",
    "Features",
    "Health",
    "LedgerUpdate",
    "Link",
    "LinkProfile",
    "Message",
    "Mode",
    "NotNegative",
    "Quality",
    "Registered",
    "SeenMode",
    "SensorSamples",
    "Sha256",
    "Shape",
    "SignedHead",
    "Smoothed",
    "TimeBase",
    "TwinState",
    "Virtual",
    "VirtualQuantity",
]

"""Modes of one epoch after the other in, identities that last out."""

from .events import Event
from .frequency import FrequencyBelief
from .shape import ShapeBelief
from .track import Track
from .tracker import ModeTracker, Tracked, Tracks

__all__ = [
    "Event",
    "FrequencyBelief",
    "ModeTracker",
    "ShapeBelief",
    "Track",
    "Tracked",
    "Tracks",
]

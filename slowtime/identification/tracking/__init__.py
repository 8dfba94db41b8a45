"""Modes of one epoch after the other in, identities that last out."""

from .events import TrackEvent
from .frequency import FrequencyBelief
from .shape import ShapeBelief
from .track import Track
from .tracker import ModeTracker, Tracked, Tracks

__all__ = [
    "FrequencyBelief",
    "ModeTracker",
    "ShapeBelief",
    "Track",
    "TrackEvent",
    "Tracked",
    "Tracks",
]

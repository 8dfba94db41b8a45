"""Modes of one epoch after the other in, identities that last out."""

from .events import Event as Event
from .frequency import FrequencyBelief as FrequencyBelief
from .shape import ShapeBelief as ShapeBelief
from .track import Track as Track
from .tracker import ModeTracker as ModeTracker
from .tracker import Tracked as Tracked
from .tracker import Tracks as Tracks

__all__ = [
    "Event",
    "FrequencyBelief",
    "ModeTracker",
    "ShapeBelief",
    "Track",
    "Tracked",
    "Tracks",
]

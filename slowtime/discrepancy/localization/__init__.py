"""What a refit leaves, in; where one unknown force would explain it, and what it does, out."""

from .character import Character, characterise
from .linear_response import ForceSource, LinearModel
from .places import PLACE_MARGIN, LatentForce, Localization, PlaceGroup
from .ranking import locate

__all__ = [
    "PLACE_MARGIN",
    "Character",
    "ForceSource",
    "LatentForce",
    "LinearModel",
    "Localization",
    "PlaceGroup",
    "characterise",
    "locate",
]

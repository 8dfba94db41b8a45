"""Residuals of a fit in, places ranked by the likelihood of an unknown force there out."""

from .character import Character, characterise
from .linear_response import ForceSource, LinearModel
from .places import PLACE_MARGIN, LatentForce, Localization, PlaceGroup
from .ranking import likeliest, locate

__all__ = [
    "PLACE_MARGIN",
    "Character",
    "ForceSource",
    "LatentForce",
    "LinearModel",
    "Localization",
    "PlaceGroup",
    "characterise",
    "likeliest",
    "locate",
]

"""Residuals of a fit in, places ranked by the likelihood of an unknown force there out."""

from .character import Character, characterise
from .linear_response import ForceSource, LinearModel
from .measured_motion import measured_motion
from .pair_ranking import NodePair, likely_pairs
from .places import PLACE_MARGIN, LatentForce, Localization, PlaceGroup
from .ranking import likeliest_places, locate

__all__ = [
    "PLACE_MARGIN",
    "Character",
    "ForceSource",
    "LatentForce",
    "LinearModel",
    "Localization",
    "NodePair",
    "PlaceGroup",
    "characterise",
    "likeliest_places",
    "likely_pairs",
    "locate",
    "measured_motion",
]

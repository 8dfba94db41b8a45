"""What a refit leaves, in; where one unknown force would explain it, and what it does, out."""

from .character import Character, character
from .linear_response import Linear, Source
from .located import PLACED, Group, Latent, Located
from .ranking import locate

__all__ = [
    "PLACED",
    "Character",
    "Group",
    "Latent",
    "Linear",
    "Located",
    "Source",
    "character",
    "locate",
]

"""A simulated acceleration board in software: motion in, messages as a real one sends out."""

from .motion import COUNT_M_PER_S2, Board, Burst
from .senders import DESTINATIONS, ReadingSender, sender_to

__all__ = ["COUNT_M_PER_S2", "DESTINATIONS", "Board", "Burst", "ReadingSender", "sender_to"]

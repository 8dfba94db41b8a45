"""Futures of a twin and a limit state in; failure probability, survival and hazard out."""

from .assessment import Assessment, assess, history
from .extremes import gumbel_of_maxima
from .states import LimitState, Resonance, ResponseLimit, Threshold

__all__ = [
    "Assessment",
    "LimitState",
    "Resonance",
    "ResponseLimit",
    "Threshold",
    "assess",
    "gumbel_of_maxima",
    "history",
]

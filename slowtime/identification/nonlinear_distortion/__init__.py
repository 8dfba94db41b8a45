"""Periodic records → best linear approximation, noise and nonlinear distortion; decays too."""

from .amplitude_decay import DecayLaw, decay_law, free_decay_extremes
from .best_linear_approximation import Distortion, distortion_of, sort_by_level
from .periods import Realisation, find_period, realisation_of
from .resonance import Resonance, fit_resonance

__all__ = [
    "DecayLaw",
    "Distortion",
    "Realisation",
    "Resonance",
    "decay_law",
    "distortion_of",
    "find_period",
    "fit_resonance",
    "free_decay_extremes",
    "realisation_of",
    "sort_by_level",
]

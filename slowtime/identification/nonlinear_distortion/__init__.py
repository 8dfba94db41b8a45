"""Periodic records → best linear approximation, noise and nonlinear distortion."""

from .best_linear_approximation import Distortion, distortion_of, sort_by_level
from .periods import Realisation, find_period, realisation_of
from .resonance import MeasuredResonance, fit_resonance

__all__ = [
    "Distortion",
    "MeasuredResonance",
    "Realisation",
    "distortion_of",
    "find_period",
    "fit_resonance",
    "realisation_of",
    "sort_by_level",
]

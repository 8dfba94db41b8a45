"""Residuals in; what of them is the sensors' own noise, white or coloured, out."""

from .colour import Colour, Noise, drifting
from .drift import Drift, drift_of, floats
from .estimate import noise_of_residual, silent_above

__all__ = [
    "Colour",
    "Drift",
    "Noise",
    "drift_of",
    "drifting",
    "floats",
    "noise_of_residual",
    "silent_above",
]

"""Residuals in; what of them is the sensors' own noise, white or coloured, out."""

from .colour import Colour, Noise
from .estimate import noise_of_residual, silent_above

__all__ = ["Colour", "Noise", "noise_of_residual", "silent_above"]

"""Residuals in; what of them is the sensors' own noise, white or coloured, out."""

from .colour import Colour, Noise, with_drift
from .drift import Drift, has_rigid_motion, rigid_body_drift
from .estimate import estimate_noise, response_limit_hz

__all__ = [
    "Colour",
    "Drift",
    "Noise",
    "estimate_noise",
    "has_rigid_motion",
    "response_limit_hz",
    "rigid_body_drift",
    "with_drift",
]

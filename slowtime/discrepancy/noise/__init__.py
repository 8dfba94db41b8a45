"""Residuals in, noise model of the sensors out."""

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

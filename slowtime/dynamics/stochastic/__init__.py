"""Springs with effects under white forces in; paths of the motion, and steps of many, out."""

from .paths import WhiteForce, means, simulate
from .springs import Springs

__all__ = ["Springs", "WhiteForce", "means", "simulate"]

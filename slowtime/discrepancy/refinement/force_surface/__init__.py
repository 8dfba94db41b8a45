"""Recovered force and motion, and records → a force surface fitted to the free run."""

from .band import surface_band
from .fitting import KIND, MAX_WORK, SurfaceFit, fit_force_surface
from .shape import AUTO, SurfaceDemand, SurfaceShape

__all__ = [
    "AUTO",
    "KIND",
    "MAX_WORK",
    "SurfaceDemand",
    "SurfaceFit",
    "SurfaceShape",
    "fit_force_surface",
    "surface_band",
]

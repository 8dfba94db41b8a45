"""Recovered force and motion, and records → a force surface fitted to the free run."""

from .band import surface_band
from .fitting import KIND, MAX_WORK, SurfaceFit, fit_force_surface
from .shape import AUTO, SurfaceDemand, SurfaceShape
from .shape_choice import ShapedRegression

__all__ = [
    "AUTO",
    "KIND",
    "MAX_WORK",
    "ShapedRegression",
    "SurfaceDemand",
    "SurfaceFit",
    "SurfaceShape",
    "fit_force_surface",
    "surface_band",
]

"""Recovered force and motion, and records → a force surface fitted to the free run."""

from .band import surface_band
from .fitting import KIND, MAX_WORK, SurfaceFit, fit_force_surface

__all__ = ["KIND", "MAX_WORK", "SurfaceFit", "fit_force_surface", "surface_band"]

"""Functional mock-up units (FMI 2.0 for co-simulation) of model files.

Descriptions come in; a unit goes out, which other simulation programs run.
"""

from .export import FmuError, write_fmu

__all__ = ["FmuError", "write_fmu"]

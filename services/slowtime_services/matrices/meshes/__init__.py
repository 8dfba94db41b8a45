"""Mesh files of Nastran, Abaqus and CalculiX → model files with a frame, and notes."""

from .conversion import Converted, convert_mesh, frame_text
from .unit_systems import UNIT_SYSTEMS

__all__ = ["UNIT_SYSTEMS", "Converted", "convert_mesh", "frame_text"]

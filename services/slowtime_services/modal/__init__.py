"""Modes and geometry in files of other programs: universal files (55, 15, 2411, 82), CSV."""

from .geometry import UNIVERSAL, Geometry, NodeAxis, name_of, places_of, read_geometry
from .modes_reader import ReadMode, ReadModes, read_modes
from .modes_writer import write_modes
from .selection_file import ENDING, SelectionFileError, read_selection, selection_text
from .tables import write_table

__all__ = [
    "ENDING",
    "UNIVERSAL",
    "Geometry",
    "NodeAxis",
    "ReadMode",
    "ReadModes",
    "SelectionFileError",
    "name_of",
    "places_of",
    "read_geometry",
    "read_modes",
    "read_selection",
    "selection_text",
    "write_modes",
    "write_table",
]

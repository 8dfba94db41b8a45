"""A model or a geometry file, and mode shapes in; a scene of the viewer, as JSON, out."""

from .scene import MeasuredShapes, ModelShapes, scene_of
from .stored import geometry_of, stored_motions, wireframe_of_geometry, with_geometry
from .wireframe import SensorMark, Wireframe, measured_wireframe, wireframe_of

__all__ = [
    "MeasuredShapes",
    "ModelShapes",
    "SensorMark",
    "Wireframe",
    "geometry_of",
    "measured_wireframe",
    "scene_of",
    "stored_motions",
    "wireframe_of",
    "wireframe_of_geometry",
    "with_geometry",
]

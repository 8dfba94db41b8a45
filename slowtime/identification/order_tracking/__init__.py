"""Records of a machine and its tacho in; amplitudes of orders against speed out."""

from .orders import Orders, resample_to_angle, track_orders
from .tacho import Rotation, rotation_of

__all__ = ["Orders", "Rotation", "resample_to_angle", "rotation_of", "track_orders"]

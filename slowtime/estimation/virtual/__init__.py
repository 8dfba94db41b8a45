"""Accelerations and a model in, quantities that nobody measures out, with their deviations."""

from .outputs import Output, displacement, drift, element_force, moment
from .sensor import VirtualSensor, VirtualState, Window
from .settings import VirtualSettings

__all__ = [
    "Output",
    "VirtualSensor",
    "VirtualSettings",
    "VirtualState",
    "Window",
    "displacement",
    "drift",
    "element_force",
    "moment",
]

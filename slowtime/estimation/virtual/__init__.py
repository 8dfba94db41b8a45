"""Accelerations and a model in, quantities that nobody measures out, with their deviations."""

from .outputs import Output, displacement, drift, element_force, moment
from .sensor import SensorWindow, VirtualSensor, VirtualState
from .settings import VirtualSettings

__all__ = [
    "Output",
    "SensorWindow",
    "VirtualSensor",
    "VirtualSettings",
    "VirtualState",
    "displacement",
    "drift",
    "element_force",
    "moment",
]

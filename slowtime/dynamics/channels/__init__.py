"""Inputs, sensors, supports and start states of a description, and checks of them."""

from .declarations import (
    BASE_KINDS,
    DISPLACED,
    IMPOSED_KINDS,
    INPUT_QUANTITIES,
    DescriptionError,
    Input,
    InputKind,
    Sensor,
    Start,
    Support,
    Where,
)

__all__ = [
    "BASE_KINDS",
    "DISPLACED",
    "IMPOSED_KINDS",
    "INPUT_QUANTITIES",
    "DescriptionError",
    "Input",
    "InputKind",
    "Sensor",
    "Start",
    "Support",
    "Where",
]

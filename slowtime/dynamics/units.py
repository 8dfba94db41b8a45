"""Units of models and records, and their SI values."""

import re
from types import MappingProxyType
from typing import Literal

from slowtime.signals.units import GRAVITY

UnitOfCoordinate = Literal["m", "rad"]
Motion = Literal["acceleration", "velocity", "displacement"]
Quantity = Literal["acceleration", "velocity", "displacement", "force"]

_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}
_ANGLES = {"rad": 1.0, "mrad": 1e-3, "deg": 3.141592653589793 / 180}
_FORCES = {"N": 1.0, "kN": 1e3, "mN": 1e-3, "MN": 1e6}
_GRAVITIES = {"g": GRAVITY, "mg": 1e-3 * GRAVITY, "gal": 1e-2}


_ANGULAR = {"m": "rad", "N": "N m", "kg": "kg m^2"}
"""Unit in place of another where the coordinate is an angle."""


def _per(lengths: dict[str, float], *ends: str) -> dict[str, float]:
    return {name + end: factor for name, factor in lengths.items() for end in ends}


UNITS = MappingProxyType(
    {
        ("m", "displacement"): _LENGTHS,
        ("m", "velocity"): _per(_LENGTHS, "/s"),
        ("m", "acceleration"): _per(_LENGTHS, "/s^2", "/s2", "/s²") | _GRAVITIES,
        ("m", "force"): _FORCES,
        ("rad", "displacement"): _ANGLES,
        ("rad", "velocity"): _per(_ANGLES, "/s"),
        ("rad", "acceleration"): _per(_ANGLES, "/s^2", "/s2", "/s²"),
        ("rad", "force"): _per(_FORCES, " m", "m", "·m"),
    }
)
"""Worth in SI of each unit, by unit of the coordinate and quantity."""


def unit_of_parameter(unit: str, coordinate: UnitOfCoordinate = "m") -> str:
    """Give the unit of an effect's parameter in a model with this coordinate.

    Effects state their units for displacements. Where the coordinate is an angle, every length
    is one, every force a torque and every mass a moment of inertia. A unit that is angular
    already stays as it is.

    Examples
    --------
    >>> unit_of_parameter("N s^2/m^2", "rad"), unit_of_parameter("m/s", "rad")
    ('N m s^2/rad^2', 'rad/s')
    >>> unit_of_parameter("N m/rad", "rad"), unit_of_parameter("N/m", "m")
    ('N m/rad', 'N/m')
    """
    above = unit.split("/")[0]
    is_angular = "rad" in unit or above.startswith(("N m", "kg m"))
    if coordinate == "m" or is_angular:
        return unit
    return re.sub("[A-Za-z]+", lambda word: _ANGULAR.get(word[0], word[0]), unit)


def unit_factor(unit: str, quantity: Quantity, coordinate: UnitOfCoordinate = "m") -> float:
    """SI value of a unit.

    Where the coordinate is an angle, a ``force`` is a torque.

    Examples
    --------
    >>> unit_factor("mm/s^2", "acceleration")
    0.001
    """
    known = UNITS[coordinate, quantity]
    if unit not in known:
        what = "torque" if (coordinate, quantity) == ("rad", "force") else quantity
        raise ValueError(
            f"{unit!r} is not a valid unit of {what}. Allowed: {', '.join(known)}."
        )
    return known[unit]

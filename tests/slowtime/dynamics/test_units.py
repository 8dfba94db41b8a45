"""Units of effects' parameters in models whose coordinate is an angle."""

import dataclasses
import re
from collections import Counter

import pytest

from slowtime.discrepancy.quoting import unit_at
from slowtime.dynamics.builders import chain
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.units import unit_of_parameter

DIMENSIONS = {
    "N": {"kg": 1, "m": 1, "s": -2},
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "Hz": {"s": -1},
    "rad": {},
}
STATED = sorted(
    {
        parameter.unit
        for kind in catalogue().values()
        for parameter in kind.parameters
        if parameter.unit and "sensor" not in parameter.unit and "^n" not in parameter.unit
    }
)


def dimension(unit: str) -> dict[str, float]:
    """Exponents of kilogram, metre and second; an angle has none."""
    found: Counter[str] = Counter()
    for sign, part in zip((1, -1), unit.split("/"), strict=False):
        for name, power in re.findall(r"([A-Za-z]+)(?:\^([\d.]+))?", part):
            for base, exponent in DIMENSIONS[name].items():
                found[base] += sign * exponent * float(power or 1)  # type: ignore[assignment]
    return {name: found[name] for name in ("kg", "m", "s")}


def test_library_states_units_of_several_dimensions():
    assert {"N", "N/m", "N s/m", "m", "kg"} <= set(STATED)


@pytest.mark.parametrize("unit", STATED)
def test_a_length_becomes_an_angle_and_a_mass_a_moment_of_inertia(unit):
    # With x = r phi, force r F is a torque and mass r^2 m is an inertia: what has k masses in
    # it has 2 k lengths, and no others.
    before, after = dimension(unit), dimension(unit_of_parameter(unit, "rad"))
    assert after == before | {"m": 2 * before["kg"]}


@pytest.mark.parametrize("unit", STATED)
def test_units_are_converted_once_and_only_for_angles(unit):
    once = unit_of_parameter(unit, "rad")
    assert unit_of_parameter(once, "rad") == once
    assert unit_of_parameter(unit, "m") == unit


@pytest.mark.parametrize(("coordinate", "unit"), [("m", "N"), ("rad", "N m")])
def test_parameters_of_a_model_are_stated_in_its_units(coordinate, unit):
    model = dataclasses.replace(
        chain([1.0], [400.0]), unit_of_coordinate=coordinate, sensors=(), inputs=()
    )
    place = Place("element", model.elements[0].id)
    rubs = Effect("coulomb", place, {"friction_n": 0.2})
    plant = Plant.of(dataclasses.replace(model, effects=(rubs.entry(),)))
    assert plant.entries["effect", 0, "friction_n"].unit == unit
    assert unit_at(model, place, "N") == unit

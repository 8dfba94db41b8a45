"""Parameters of a plant: names, values, units and tolerances."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from slowtime.dynamics.description import Beam, Description, Matrix, Spring
from slowtime.dynamics.effects import Effect, Hidden, Kind, Place
from slowtime.dynamics.units import unit_of_parameter

FARTHEST = 100.0
"""Factor by which a factor may move: nothing at all explains whatever masses may vanish."""

LIGHTEST = 0.05
"""Share of its mass that a node keeps: one that weighs next to nothing explains whatever."""

Name = tuple[str, str] | tuple[str, int, str]
"""("stiffness", "j1"), ("damping", "j1"), ("mass", "m1"), or ("effect", 0, "friction_n")."""


@dataclasses.dataclass(frozen=True, slots=True)
class ParameterEntry:
    """One number: value, unit, standard deviation of what is claimed, bounds, to be fitted."""

    value: float
    unit: str
    sd: float
    low: float
    high: float
    fitted: bool


def names_of(
    description: Description, effects: tuple[Effect, ...], kinds: Mapping[str, Kind]
) -> dict[Name, ParameterEntry]:
    """Every number of a description, in order: stiffness, damping, mass, effects.

    Where a description has no tolerance, nothing is claimed and the standard deviation is
    infinite; so it is of the parameters of effects, but for those with a spread of their own.
    """
    found: dict[Name, ParameterEntry] = {}
    angle = description.unit_of_coordinate == "rad"
    units = {
        "stiffness": "N m/rad" if angle else "N/m",
        "damping": "N m s/rad" if angle else "N s/m",
        "mass": "kg m^2" if angle else "kg",
    }

    exact = {
        part.id for part in description.elements if isinstance(part, Matrix) and part.exact
    }

    def add(what: str, name: str, value: float, unit: str | None = None) -> None:
        share = math.inf
        if description.tolerance is not None:
            share = getattr(description.tolerance, what)
        share = 0.0 if name in exact else share
        sd = math.inf if math.isinf(share) else share * abs(value)
        low = -math.inf if what == "damping" else 0.0
        found[what, name] = ParameterEntry(value, unit or units[what], sd, low, math.inf, True)

    springs = [element for element in description.elements if isinstance(element, Spring)]
    beams = [element for element in description.elements if isinstance(element, Beam)]
    matrices = [element for element in description.elements if isinstance(element, Matrix)]
    for spring in springs:
        add("stiffness", spring.id, spring.stiffness_n_per_m)
    for beam in beams:
        add("stiffness", beam.id, beam.bending_stiffness_n_m2, "N m^2")
    for matrix in matrices:
        if matrix.stiffness_terms:
            add("stiffness", matrix.id, matrix.stiffness_factor, "1")
    for spring in springs:
        add("damping", spring.id, spring.damping_n_s_per_m)
    for beam in beams:
        add("damping", beam.id, beam.damping_s, "s")
    for matrix in matrices:
        if matrix.damping_terms:
            add("damping", matrix.id, matrix.damping_factor, "1")
    felt = {sensor.node for sensor in description.sensors if sensor.quantity == "force"}
    for node in description.nodes:
        if node.mass_kg:
            add("mass", node.id, node.mass_kg)
            if node.id in description.moved and node.id not in felt:
                # Its motion is imposed, and nothing measured depends on its mass.
                found["mass", node.id] = dataclasses.replace(
                    found["mass", node.id], sd=0.0, fitted=False
                )
    for beam in beams:
        if beam.mass_kg_per_m:
            add("mass", beam.id, beam.mass_kg_per_m, "kg/m")
    for matrix in matrices:
        if matrix.mass_terms:
            add("mass", matrix.id, matrix.mass_factor, "1")
    for i, effect in enumerate(effects):
        kind = kinds[effect.kind]
        values = kind.values(effect.parameters).tolist()
        known = dict(zip(kind.names, values, strict=True))
        for parameter, value in zip(kind.parameters, values, strict=True):
            low, high = parameter.bounds(known)
            low = max(low, lowest(description, effect.place, kind))
            if parameter.nonzero and value and math.isinf(low) and math.isinf(high):
                low, high = sorted((value / FARTHEST, value * FARTHEST))
            found["effect", i, parameter.name] = ParameterEntry(
                value,
                unit_of_parameter(parameter.unit, description.unit_of_coordinate),
                known.get(parameter.spread, math.inf),
                low,
                high,
                parameter.fitted,
            )
    return found


def lowest(description: Description, place: Place, kind: Kind) -> float:
    """Value that the one parameter of a kind must stay above, lest a node weigh nothing."""
    action = kind.action
    if not isinstance(action, Hidden) or kind.where != "node" or len(kind.parameters) != 1:
        return -math.inf
    gained = float(action.matrices(np.ones(1))[0][0, 0])
    mass = next(node.mass_kg for node in description.nodes if node.id == place.id)
    return -(1 - LIGHTEST) * mass / gained if gained > 0 and mass > 0 else -math.inf

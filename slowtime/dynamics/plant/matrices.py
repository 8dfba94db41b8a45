r"""Mass, damping and stiffness matrices with derivatives to the parameters.

All are over the free coordinates, the hidden ones that effects bring, and the base last. Where
hidden masses are at rest against the base they are carried along, as the nodes are.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.description import Beam, Description, places, spread
from slowtime.dynamics.effects import Effect, Hidden, Kind
from slowtime.dynamics.elements import ROTATION

from .parameter_names import Name

Whole = Float[np.ndarray, "all all"]
Triple = Float[np.ndarray, "3 all all"]
"""Mass, damping, stiffness."""

NUDGE = 1e-4
"""Relative step of central differences of what hidden coordinates add: exact for squares, and
to a part in 10^8 for cubes."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Matrices:
    """What the matrices of a plant are made of.

    Parameters
    ----------
    constant
        What no parameter changes: rotary inertia.
    units
        By name: mass, damping and stiffness for a value of one, other values standing by.
    beams
        Names of beams, whose damping is their stiffness times a parameter.
    hidden
        By number of the effect: its law, and where its own coordinates stand in the whole.
    names
        Of the free coordinates, hidden ones too.
    """

    constant: Triple
    units: Mapping[Name, Triple]
    beams: tuple[str, ...]
    hidden: Mapping[int, tuple[Hidden, Float[np.ndarray, "own all"]]]
    names: tuple[str, ...]

    @classmethod
    def of(
        cls, description: Description, effects: tuple[Effect, ...], kinds: Mapping[str, Kind]
    ) -> "Matrices":
        """Take a description apart."""
        actions = [kinds[effect.kind].action for effect in effects]
        riders = [
            f"{effect.kind} {i}.{k + 1}"
            for i, (effect, action) in enumerate(zip(effects, actions, strict=True))
            if isinstance(action, Hidden)
            for k in range(action.coordinates)
        ]
        free, size = len(description.dofs), len(description.dofs) + len(riders) + 1
        place = places(description)
        place = {name: size - 1 if row == free else row for name, row in place.items()}
        constant, units = _units(description, place, size)
        hidden, next_row = {}, free
        for i, (effect, action) in enumerate(zip(effects, actions, strict=True)):
            if isinstance(action, Hidden):
                to = np.zeros((1 + action.coordinates, size))
                to[0] = along(description, effect, place, size)
                for k in range(action.coordinates):
                    to[1 + k, next_row] = 1.0
                    next_row += 1
                hidden[i] = action, to
        beams = tuple(part.id for part in description.elements if isinstance(part, Beam))
        return cls(constant, units, beams, hidden, (*description.dofs, *riders))

    def at(self, values: Mapping[Name, float], kinds: list[Kind]) -> Triple:
        """Compute mass, damping and stiffness at values of the parameters.

        Parameters
        ----------
        values
            Values of all parameters, by name, in SI units.
        kinds
            Kind of each effect.

        Returns
        -------
        Mass, damping and stiffness over all coordinates, in SI units.
        """
        whole = self.constant.copy()
        for name, unit in self.units.items():
            whole += values[name] * unit
        for beam in self.beams:
            bent = values["stiffness", beam] * self.units["stiffness", beam][2]
            whole[1] += values["damping", beam] * bent
        for i, (action, to) in self.hidden.items():
            own = np.array([values["effect", i, name] for name in kinds[i].names])
            whole += to.T @ np.array(action.matrices(own)) @ to
        return whole

    def slope(self, name: Name, values: Mapping[Name, float], kinds: list[Kind]) -> Triple:
        """Differentiate the matrices to one parameter.

        Parameters
        ----------
        name
            Name of the parameter.
        values
            Values of all parameters, by name, in SI units.
        kinds
            Kind of each effect.

        Returns
        -------
        Derivatives of mass, damping and stiffness, in SI units.
        """
        if len(name) == 3:
            _, i, key = name
            action, to = self.hidden[i]
            own = np.array([values["effect", i, part] for part in kinds[i].names])
            place = kinds[i].names.index(key)
            step = np.zeros(len(own))
            step[place] = NUDGE * abs(own[place]) or NUDGE
            above, below = (np.array(action.matrices(own + sign * step)) for sign in (1, -1))
            return np.asarray(to.T @ (above - below) @ to / (2 * step[place]))
        found = self.units[name].copy() if name in self.units else np.zeros_like(self.constant)
        if name[1] in self.beams and name[0] != "mass":
            bending = self.units["stiffness", name[1]][2]
            other = "damping" if name[0] == "stiffness" else "stiffness"
            found[1] += values[other, name[1]] * bending
        return found


def along(
    description: Description, effect: Effect, place: Mapping[str, int | None], size: int
) -> Float[np.ndarray, " all"]:
    """Row that takes from all coordinates the elongation of an element, or a node's motion."""
    found = np.zeros(size)
    if effect.place.kind == "node":
        ends = ((effect.place.id, 1.0),)
    else:
        between = next(e.between for e in description.elements if e.id == effect.place.id)
        ends = ((between[0], -1.0), (between[1], 1.0))  # type: ignore[assignment]
    for name, sign in ends:
        row = place[name]
        # Coordinates are relative to the base, which therefore stands still.
        if row is not None and row != size - 1:
            found[row] += sign
    return found


def _units(
    description: Description, place: Mapping[str, int | None], size: int
) -> tuple[Triple, dict[Name, Triple]]:
    constant, units = np.zeros((3, size, size)), {}

    def add(name: Name, which: int, matrix: Whole) -> None:
        units[name] = np.zeros((3, size, size))
        units[name][which] = matrix

    for node in description.nodes:
        add(("mass", node.id), 0, spread(np.eye(1), (node.id,), place, size))
        if node.rotary_inertia_kg_m2:
            turning = node.rotary_inertia_kg_m2 * np.eye(1)
            constant[0] += spread(turning, (node.id + ROTATION,), place, size)
        if not node.mass_kg:
            del units["mass", node.id]
    for part in description.elements:
        if isinstance(part, Beam):
            one = dataclasses.replace(
                part, bending_stiffness_n_m2=1.0, mass_kg_per_m=1.0, damping_s=0.0
            )
            add(("stiffness", part.id), 2, spread(one.stiffness(), part.dofs, place, size))
            if part.mass_kg_per_m:
                add(("mass", part.id), 0, spread(one.mass(), part.dofs, place, size))
        else:
            stretched = dataclasses.replace(part, stiffness_n_per_m=1.0).stiffness()
            for which, what in ((2, "stiffness"), (1, "damping")):
                add((what, part.id), which, spread(stretched, part.dofs, place, size))
    return constant, units

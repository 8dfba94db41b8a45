r"""Mass, damping and stiffness matrices with derivatives to the parameters.

All are over the free coordinates, the hidden ones that effects bring, the base, and what inputs
move: supports and driven nodes. A row more for each force sensor gives its reading along these.
Where hidden masses are at rest against the base they are carried along, as the nodes are.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.description import BASE, Beam, Description, Matrix, places, spread
from slowtime.dynamics.effects import Effect, Hidden, Kind
from slowtime.dynamics.elements import ROTATION

from .parameter_names import Name

Whole = Float[np.ndarray, "all all"]
Triple = Float[np.ndarray, "3 all all"]
"""Mass, damping, stiffness."""

NUDGE = 1e-4
"""Relative step of central differences of what hidden coordinates add: exact for squares, and
to a part in 10^8 for cubes."""


@dataclasses.dataclass(frozen=True, slots=True)
class Gauge:
    """Where a force is measured.

    Parameters
    ----------
    element
        Whose force it is; None for a reaction.
    row
        Of the whole: of the element's second end, or of what is held or driven.
    """

    element: str | None
    row: int


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class MatrixParts:
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
    ridden
        Name of the element that each hidden effect works along; None at a node.
    """

    constant: Triple
    units: Mapping[Name, Triple]
    beams: tuple[str, ...]
    hidden: Mapping[int, tuple[Hidden, Float[np.ndarray, "own all"]]]
    names: tuple[str, ...]
    moved: tuple[str, ...] = ()
    gauges: tuple[Gauge, ...] = ()
    ridden: Mapping[int, str | None] = dataclasses.field(default_factory=dict)

    @classmethod
    def of(
        cls, description: Description, effects: tuple[Effect, ...], kinds: Mapping[str, Kind]
    ) -> "MatrixParts":
        """Take a description apart."""
        actions = [kinds[effect.kind].action for effect in effects]
        riders = [
            f"{effect.kind} {i}.{k + 1}"
            for i, (effect, action) in enumerate(zip(effects, actions, strict=True))
            if isinstance(action, Hidden)
            for k in range(action.coordinates)
        ]
        next_row = len(description.dofs)
        place = rows_of(description, next_row + len(riders))
        measured = [sensor for sensor in description.sensors if sensor.quantity == "force"]
        size = next_row + len(riders) + 1 + len(description.moved) + len(measured)
        constant, units = _units(description, place, size)
        hidden = {}
        for i, (effect, action) in enumerate(zip(effects, actions, strict=True)):
            if isinstance(action, Hidden):
                to = np.zeros((1 + action.ends + action.coordinates, size))
                if action.ends:
                    to[:2] = ends_of(description, effect, place, size)
                else:
                    to[0] = along(description, effect, place, size)
                for k in range(action.coordinates):
                    to[1 + k, next_row] = 1.0
                    next_row += 1
                hidden[i] = action, to
        ends = {part.id: part.between[1] for part in description.elements}
        gauges = [
            Gauge(one.element, place[ends[one.element] if one.element else one.node] or 0)
            for one in measured
        ]
        return cls(
            constant=constant,
            units=units,
            beams=tuple(part.id for part in description.elements if isinstance(part, Beam)),
            hidden=hidden,
            names=(*description.dofs, *riders),
            moved=description.moved,
            gauges=tuple(gauges),
            ridden={
                i: effects[i].place.id if effects[i].place.kind == "element" else None
                for i in hidden
            },
        )

    def at(self, values: Mapping[Name, float], kinds: list[Kind]) -> Triple:
        """Compute mass, damping and stiffness at values of the parameters."""
        whole = self.constant.copy()
        for name, unit in self.units.items():
            whole += values[name] * unit
        for beam in self.beams:
            bent = values["stiffness", beam] * self.units["stiffness", beam][2]
            whole[1] += values["damping", beam] * bent
        inner: dict[int, Triple] = {}
        for i, (action, to) in self.hidden.items():
            own = np.array([values["effect", i, name] for name in kinds[i].names])
            inner[i] = np.array(action.matrices(own)) @ to
            whole += to.T @ inner[i]
        if self.gauges:
            self._measure(whole, values, inner)
        return whole

    def slope(self, name: Name, values: Mapping[Name, float], kinds: list[Kind]) -> Triple:
        """Differentiate the matrices to one parameter."""
        if len(name) == 3:
            _, i, key = name
            action, to = self.hidden[i]
            own = np.array([values["effect", i, part] for part in kinds[i].names])
            place = kinds[i].names.index(key)
            step = np.zeros(len(own))
            step[place] = NUDGE * abs(own[place]) or NUDGE
            above, below = (np.array(action.matrices(own + sign * step)) for sign in (1, -1))
            inner = (above - below) @ to / (2 * step[place])
            whole = np.asarray(to.T @ inner)
            self._measure(whole, {}, {i: inner})
            return whole
        found = self.units[name].copy() if name in self.units else np.zeros_like(self.constant)
        if name[1] in self.beams and name[0] != "mass":
            bending = self.units["stiffness", name[1]][2]
            other = "damping" if name[0] == "stiffness" else "stiffness"
            found[1] += values[other, name[1]] * bending
        self._measure(found, {name: 1.0}, {})
        return found

    def _measure(
        self, whole: Triple, values: Mapping[Name, float], inner: Mapping[int, np.ndarray]
    ) -> None:
        """Write the rows of the force sensors, in place."""
        # `values` are those of the constants whose share is wanted; `inner` gives, by number of
        # a hidden effect, the forces in its own coordinates.
        first = whole.shape[1] - len(self.gauges)
        for k, gauge in enumerate(self.gauges):
            if gauge.element is None:
                whole[:, first + k] = whole[:, gauge.row]
                continue
            for name in (("stiffness", gauge.element), ("damping", gauge.element)):
                if name in values:
                    whole[:, first + k] += values[name] * self.units[name][:, gauge.row]
            for i, forces in inner.items():
                if self.ridden[i] == gauge.element:
                    whole[:, first + k] += forces[:, 0]


def rows_of(description: Description, base: int) -> dict[str, int | None]:
    """Row of each coordinate in the whole: see `MatrixParts`."""
    held = len(description.dofs)
    found = {name: base if row == held else row for name, row in places(description).items()}
    return found | {name: base + 1 + k for k, name in enumerate(description.moved)}


def along(
    description: Description, effect: Effect, place: Mapping[str, int | None], size: int
) -> Float[np.ndarray, " all"]:
    """Row that takes from all coordinates the elongation of an element, or a node's motion.

    Of an effect on an input, the node that its force pushes; zero on a sensor.
    """
    found = np.zeros(size)
    ends: tuple[tuple[str, float], ...]
    if effect.place.kind == "sensor":
        ends = ()
    elif effect.place.kind == "input":
        entry = next(one for one in description.inputs if one.channel == effect.place.id)
        ends = ((entry.node, 1.0),) if entry.kind == "force" and entry.node else ()
    elif effect.place.kind == "node":
        ends = ((effect.place.id, 1.0),)
    else:
        between = next(e.between for e in description.elements if e.id == effect.place.id)
        ends = ((between[0], -1.0), (between[1], 1.0))
    for name, sign in ends:
        row = place[name]
        # Coordinates are relative to the base, which therefore stands still.
        if row is not None and row != place[BASE]:
            found[row] += sign
    return found


def ends_of(
    description: Description, effect: Effect, place: Mapping[str, int | None], size: int
) -> Float[np.ndarray, "2 all"]:
    """Rows that take from all coordinates the motions of the ends of an element."""
    between = next(e.between for e in description.elements if e.id == effect.place.id)
    found = np.zeros((2, size))
    for own, name in zip(found, between, strict=True):
        row = place[name]
        if row is not None and row != place[BASE]:
            own[row] = 1.0
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
        elif isinstance(part, Matrix):
            plain = dataclasses.replace(
                part, stiffness_factor=1.0, mass_factor=1.0, damping_factor=1.0
            )
            for which, what in ((0, "mass"), (1, "damping"), (2, "stiffness")):
                own = getattr(plain, what)()
                if own.any():
                    add((what, part.id), which, spread(own, part.dofs, place, size))
        else:
            stretched = dataclasses.replace(part, stiffness_n_per_m=1.0).stiffness()
            for which, what in ((2, "stiffness"), (1, "damping")):
                add((what, part.id), which, spread(stretched, part.dofs, place, size))
    return constant, units

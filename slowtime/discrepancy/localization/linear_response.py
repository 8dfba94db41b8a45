r"""Frequency responses of the sensors to a force at any place.

.. math:: q(\omega) = (-\omega^2 M + i \omega C + K)^{-1} \, (l_p w - (M \iota + m_b) a_b) ,

A sensor reads :math:`(i \omega)^n` times a coordinate, plus the motion of the base where it
measures absolute motion.
"""

import dataclasses

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.dynamics.description import (
    BASE,
    Description,
    Spring,
    assemble,
    assemble_parts,
    moves_with_base,
)
from slowtime.dynamics.effects import Place
from slowtime.dynamics.elements import ROTATION
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.structure import Structure, state_matrix
from slowtime.dynamics.transfer import derivative_order
from slowtime.dynamics.units import unit_factor

from .modal_spectra import (
    DenseDecays,
    DenseResponse,
    FreeDecaySpectra,
    ModalDecays,
    ModalResponse,
    StateModes,
    SteadyResponse,
)

Frequencies = Float[np.ndarray, " frequency"]

MAX_MODE_CONDITION = 1e6
"""[1] Condition number of the modal matrix up to which modes are used. Source: leaves ten
digits of double precision."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ForceSource:
    """A place where an unknown force may act.

    Parameters
    ----------
    force
        On each degree of freedom, per unit force [N], or per acceleration of the base [m/s^2].
    base
        1 for a motion of the base, which absolute sensors read directly; else 0.
    sensor
        Number of the sensor to whose reading it is added instead; else None.
    """

    place: Place
    force: Float[np.ndarray, " dof"]
    base: float = 0.0
    sensor: int | None = None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LinearModel:
    """Linear part of a description, with its sensors.

    Parameters
    ----------
    rows
        Coordinate that each sensor reads, relative to the base.
    """

    description: Description
    structure: Structure
    rows: Float[np.ndarray, "sensor dof"]
    orders: tuple[int, ...]
    absolute: Float[np.ndarray, " sensor"]
    scale: Float[np.ndarray, " sensor"]

    @classmethod
    def of(cls, description: Description) -> "LinearModel":
        """Take the linear part of a description; its effects are left out."""
        return cls._over(description, assemble(description))

    @classmethod
    def of_plant(cls, plant: Plant, values: Float[np.ndarray, " parameter"]) -> "LinearModel":
        """Take the linear part of a plant, with what its effects add to it.

        Hidden coordinates of effects come after those of the description.
        """
        named = dict(zip(plant.parameters, values.tolist(), strict=True))
        kinds = [plant.kinds[effect.kind] for effect in plant.effects]
        whole = plant.matrices.at(named, kinds)
        names = plant.matrices.names
        free = len(names)
        linear = {name: value for name, value in named.items() if name[0] != "effect"}
        structure = Structure(
            mass=whole[0, :free, :free],
            damping=whole[1, :free, :free],
            stiffness=whole[2, :free, :free],
            names=names,
            influence=np.array([not name.endswith(ROTATION) for name in names], float),
            base_mass=whole[0, :free, free],
            gyroscopic=True,
        )
        over = cls._over(with_values(plant.description, linear), structure)
        # The factor of a sensor also scales its response to a missing force.
        scale = over.scale.copy()
        for number, (effect, kind) in enumerate(zip(plant.effects, kinds, strict=True)):
            if kind.where == "sensor" and kind.is_factor:
                channel = [s.channel for s in plant.description.sensors].index(effect.place.id)
                scale[channel] *= named["effect", number, kind.names[0]]
        return dataclasses.replace(over, scale=scale)

    @classmethod
    def _over(cls, description: Description, structure: Structure) -> "LinearModel":
        rows = np.zeros((len(description.sensors), structure.dofs))
        for i, sensor in enumerate(description.sensors):
            if sensor.node in structure.names:
                rows[i, structure.dof(sensor.node)] = 1.0
        factors = [
            unit_factor(sensor.unit, sensor.quantity, description.unit_of_coordinate)
            for sensor in description.sensors
        ]
        return cls(
            description=description,
            structure=structure,
            rows=rows,
            # Measured forces are fitted, but do not help to locate: no row reads them.
            orders=tuple(
                0 if s.quantity == "force" else derivative_order(s.quantity)
                for s in description.sensors
            ),
            absolute=np.array(
                [
                    float(s.frame == "absolute" and s.quantity != "force")
                    for s in description.sensors
                ]
            ),
            scale=1.0 / np.array(factors),
        )

    def compliance(self, frequency_hz: Frequencies) -> Complex[np.ndarray, "frequency dof dof"]:
        """Displacement per force [m/N]; zero at 0 Hz where rigid modes make it infinite."""
        s = 2j * np.pi * frequency_hz[:, None, None]
        structure = self.structure
        stiffness = s**2 * structure.mass + s * structure.damping + structure.stiffness
        held = self._held(frequency_hz)[:, None, None]
        safe = np.where(held > 0, stiffness, np.eye(structure.dofs))
        return np.asarray(held * np.linalg.inv(safe))

    def state_modes(self) -> StateModes | None:
        """Find the modes of the free state; None where they do not span all motion."""
        poles, modes = np.linalg.eig(state_matrix(self.structure))
        dofs = self.structure.dofs
        if not np.linalg.cond(modes) < MAX_MODE_CONDITION:
            return None
        back = np.linalg.inv(modes)
        pushed = np.linalg.solve(self.structure.mass.T, back[:, dofs:].T).T
        return StateModes(poles + 0j, modes + 0j, back + 0j, pushed + 0j)

    def steady_response(
        self, frequency_hz: Frequencies, modes: StateModes | None
    ) -> SteadyResponse:
        """Displacement per force, by modes (`state_modes`) or by inverses without them."""
        if modes is None:
            return DenseResponse(self.compliance(frequency_hz))
        apart = np.subtract.outer(2j * np.pi * frequency_hz, modes.poles)
        # It is zero at 0 Hz where rigid modes make it infinite.
        held = self._held(frequency_hz)
        if not apart[held > 0].all():
            return DenseResponse(self.compliance(frequency_hz))
        gains = held[:, None] / np.where(held[:, None] > 0, apart, 1.0)
        return ModalResponse(modes.shapes[: self.structure.dofs], gains, modes.pushed)

    def _held(self, frequency_hz: Frequencies) -> Float[np.ndarray, " frequency"]:
        """1 for each line at which the model resists a steady force, else 0."""
        dofs = self.structure.dofs
        floats = np.linalg.matrix_rank(self.structure.stiffness) < dofs
        return np.where(frequency_hz > 0, 1.0, 0.0 if floats else 1.0)

    def sensor_response(
        self,
        frequency_hz: Frequencies,
        displacement: Complex[np.ndarray, "frequency dof *more"],
    ) -> Complex[np.ndarray, "frequency sensor *more"]:
        """Convert steady displacement relative to the base to readings of the sensors."""
        read = np.moveaxis(np.tensordot(self.rows, displacement, axes=(1, 1)), 0, 1)
        return self.readings_of_rows(frequency_hz, read)

    def readings_of_rows(
        self, frequency_hz: Frequencies, read: Complex[np.ndarray, "frequency sensor *more"]
    ) -> Complex[np.ndarray, "frequency sensor *more"]:
        """Convert displacements along the rows of the sensors to their readings."""
        s = 2j * np.pi * frequency_hz
        gain = self.scale * s[:, None] ** np.array(self.orders)
        return np.asarray(gain.reshape(gain.shape + (1,) * (read.ndim - 2)) * read)

    def base_response(
        self, frequency_hz: Frequencies
    ) -> Complex[np.ndarray, "frequency sensor"]:
        """Give the readings of absolute sensors on a rigid structure per m/s^2 of the base."""
        s = 2j * np.pi * np.where(frequency_hz > 0, frequency_hz, 1.0)[:, None]
        order = np.array(self.orders) - 2
        moving = (frequency_hz[:, None] > 0) | (order == 0)
        return np.asarray(np.where(moving, self.absolute * self.scale * s**order, 0.0))

    def free_decay(
        self, samples: int, rate_hz: float, state: Float[np.ndarray, " state"]
    ) -> tuple[Float[np.ndarray, "time sensor"], Float[np.ndarray, "order time dof"]]:
        """Simulate readings (time, sensor), and displacement, velocity, acceleration."""
        step = scipy.linalg.expm(state_matrix(self.structure) / rate_hz)
        whole = _powers_of_state(step, state, samples) @ self.state_to_motion.T
        motion = whole.reshape(samples, 3, self.structure.dofs)
        sensed = [motion[:, order] @ self.rows[i] for i, order in enumerate(self.orders)]
        return np.stack(sensed, axis=1) * self.scale, np.asarray(np.moveaxis(motion, 1, 0))

    def free_decay_spectra(
        self,
        frequency_hz: Frequencies,
        samples: int,
        rate_hz: float,
        modes: StateModes | None = None,
    ) -> FreeDecaySpectra:
        r"""Spectra of free decays in closed form: :math:`(I - E^N)(I - E z^{-1})^{-1}`."""
        back = np.exp(-2j * np.pi * frequency_hz / rate_hz)
        scale = np.full(len(frequency_hz), np.sqrt(2.0 / (rate_hz * samples)))
        scale[frequency_hz == 0] /= np.sqrt(2.0)
        scale[np.isclose(frequency_hz, rate_hz / 2)] /= np.sqrt(2.0)
        to_motion = self.state_to_motion
        sensed = to_motion.reshape(3, self.structure.dofs, -1)
        rows = [self.rows[i] @ sensed[order] for i, order in enumerate(self.orders)]
        to_readings = self.scale[:, None] * np.stack(rows)
        # An undamped motion has its pole on a line; one part in 1e9 moves it away.
        if modes is not None:
            step = np.exp(modes.poles / rate_hz)
            gains = scale[:, None] / (1 + 1e-9 - np.multiply.outer(back, step))
            ended = -np.expm1(modes.poles * (samples / rate_hz))
            return ModalDecays(
                to_motion, to_readings, modes.shapes, gains, ended[:, None] * modes.back
            )
        matrix = scipy.linalg.expm(state_matrix(self.structure) / rate_hz)
        rest = np.eye(len(matrix))
        ended = rest - np.linalg.matrix_power(matrix, samples)
        inner = (1 + 1e-9) * rest - matrix * back[:, None, None]
        states = np.linalg.solve(inner, ended[None]) * scale[:, None, None]
        return DenseDecays(to_motion, to_readings, states)

    @property
    def state_to_motion(self) -> Float[np.ndarray, "all state"]:
        """Matrix from a free state to displacements, velocities and accelerations."""
        dofs = self.structure.dofs
        inner = np.hstack([self.structure.stiffness, self.structure.damping])
        return np.vstack([np.eye(2 * dofs), -np.linalg.solve(self.structure.mass, inner)])

    def tuned(
        self,
        stiffness: Float[np.ndarray, "dof dof"],
        damping: Float[np.ndarray, "dof dof"],
        mass: Float[np.ndarray, "dof dof"],
    ) -> "LinearModel":
        """Add to the matrices of stiffness, damping and mass."""
        structure = self.structure
        changed = dataclasses.replace(
            structure,
            stiffness=structure.stiffness + stiffness,
            damping=structure.damping + damping,
            mass=structure.mass + mass,
        )
        return dataclasses.replace(self, structure=changed)

    def sources(self) -> tuple[ForceSource, ...]:
        """List all places: elements, nodes, base, inputs, sensors."""
        return (
            *self._elements(),
            *self._nodes(),
            *self._base(),
            *self._inputs(),
            *self._sensors(),
        )

    def elongation(self, place: Place) -> Float[np.ndarray, " dof"]:
        """Row that gives the coordinate along a place: second node minus first, or the node."""
        names = [place.id]
        signs = [1.0]
        if place.kind == "element":
            element = next(e for e in self.description.elements if e.id == place.id)
            names, signs = list(element.between), [-1.0, 1.0]
        along = np.zeros(self.structure.dofs)
        for name, sign in zip(names, signs, strict=True):
            if name in self.structure.names:
                along[self.structure.dof(name)] += sign
        return along

    def elongation_of_supports(self, place: Place) -> Float[np.ndarray, " moved"]:
        """Row that gives what supports and driven nodes add to the coordinate of a place."""
        moved = self.description.moved
        along = np.zeros(len(moved))
        if place.kind == "element":
            element = next(e for e in self.description.elements if e.id == place.id)
            for name, sign in zip(element.between, (-1.0, 1.0), strict=True):
                if name in moved:
                    along[moved.index(name)] += sign
        return along

    def _elements(self) -> list[ForceSource]:
        places = [
            Place("element", e.id) for e in self.description.elements if isinstance(e, Spring)
        ]
        return [ForceSource(place=p, force=-self.elongation(p)) for p in places]

    def _nodes(self) -> list[ForceSource]:
        names = [n.id for n in self.description.nodes if n.id in self.structure.names]
        places = [Place("node", name) for name in names]
        return [ForceSource(place=p, force=self.elongation(p)) for p in places]

    def _base(self) -> list[ForceSource]:
        if not moves_with_base(self.description):
            return []
        return [ForceSource(place=Place("base", BASE), force=self.base_force(), base=1.0)]

    def base_force(self) -> Float[np.ndarray, " dof"]:
        """Force on each coordinate per m/s^2 of the base."""
        return np.asarray(self.structure.base_force(np.ones(1))[0])

    def _inputs(self) -> list[ForceSource]:
        found = []
        for entry in self.description.inputs:
            place = Place("input", entry.channel)
            if entry.kind == "base_acceleration":
                found.append(ForceSource(place=place, force=self.base_force(), base=1.0))
            elif entry.kind == "force" and entry.node is not None:
                force = self.elongation(Place("node", entry.node))
                found.append(ForceSource(place=place, force=force))
        return found

    def _sensors(self) -> list[ForceSource]:
        rest = np.zeros(self.structure.dofs)
        return [
            ForceSource(place=Place("sensor", sensor.channel), force=rest, sensor=i)
            for i, sensor in enumerate(self.description.sensors)
        ]


def _powers_of_state(
    step: Float[np.ndarray, "state state"], state: Float[np.ndarray, " state"], samples: int
) -> Float[np.ndarray, "time state"]:
    """Apply the powers of a step matrix to a state, doubling their number each time."""
    known, ahead = state[None], step
    while len(known) < samples:
        known = np.concatenate([known, known @ ahead.T])
        ahead = ahead @ ahead
    return known[:samples]


def support_columns(
    description: Description,
) -> dict[tuple[str, str], Float[np.ndarray, "dof moved"]]:
    """Give the force on each coordinate per motion of each support, by name of the constant."""
    rows = {name: row for row, name in enumerate(description.dofs)}
    moved = description.moved
    # Signs are those of the stiffness matrix: a spring of stiffness k has -k here.
    found: dict[tuple[str, str], Float[np.ndarray, "dof moved"]] = {}
    for part in description.elements:
        if not isinstance(part, Spring):
            continue
        first, second = part.between
        for end, other in ((first, second), (second, first)):
            if end not in moved or other not in rows:
                continue
            for what, value in (
                ("stiffness", part.stiffness_n_per_m),
                ("damping", part.damping_n_s_per_m),
            ):
                column = np.zeros((len(rows), len(moved)))
                column[rows[other], moved.index(end)] = -value
                found[what, part.id] = column
    return found


def parameter_matrices(
    description: Description,
) -> dict[tuple[str, str], Float[np.ndarray, "dof dof"]]:
    """Give the contribution of each constant to stiffness, damping or mass, by its name."""
    parts = assemble_parts(description)
    found = {("stiffness", name): part for name, part in parts.stiffness_parts.items()}
    found |= {("damping", name): part for name, part in parts.damping_parts.items()}
    return found | {("mass", name): part for name, part in parts.mass_parts.items()}

r"""How a force at any place shows at the sensors, line by line of a spectrum.

.. math:: q(\omega) = (-\omega^2 M + i \omega C + K)^{-1} \, (l_p w - (M \iota + m_b) a_b) ,

a sensor being :math:`(i \omega)^n` times a coordinate, and the base's own motion on top where
it measures in space.
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
)
from slowtime.dynamics.effects import Place
from slowtime.dynamics.elements import ROTATION
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.structure import Structure, state_matrix
from slowtime.dynamics.transfer import derivative_order
from slowtime.dynamics.units import unit_factor

Frequencies = Float[np.ndarray, " frequency"]

APART = 1e6
"""Condition of a matrix of modes up to which they are told apart."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Source:
    """A place where something unknown may act.

    Parameters
    ----------
    force
        On each degree of freedom, per unit of what acts [N], or [m/s^2] of the base.
    base
        1 for a motion of the base, which sensors in space feel by themselves; else 0.
    sensor
        Number of the sensor that it is added to instead; else None.
    """

    place: Place
    force: Float[np.ndarray, " dof"]
    base: float = 0.0
    sensor: int | None = None


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FreeSpectra:
    """Spectra of free motion, from each unit of initial displacement and velocity.

    Parameters
    ----------
    modes
        States by mode.
    share
        How much of each mode there is at each line, from each initial state.
    """

    linear: "Linear"
    modes: Complex[np.ndarray, "state mode"]
    share: Complex[np.ndarray, "mode frequency state"]

    @property
    def sensed(self) -> Complex[np.ndarray, "frequency sensor state"]:
        """As the sensors tell it."""
        one = self.linear
        motion = (one.by_state @ self.modes).reshape(3, one.structure.dofs, -1)
        rows = [one.rows[i] @ motion[order] for i, order in enumerate(one.orders)]
        told = one.scale[:, None] * np.stack(rows)
        return np.asarray(np.moveaxis(np.tensordot(told, self.share, axes=1), 0, 1))

    def moved(
        self, state: Float[np.ndarray, " state"]
    ) -> Complex[np.ndarray, "order frequency dof"]:
        """Displacement, velocity and acceleration of all coordinates, from one state."""
        motion = self.linear.by_state @ self.modes @ (self.share @ state)
        shape = (3, self.linear.structure.dofs, motion.shape[1])
        return np.asarray(np.moveaxis(motion.reshape(shape), 1, 2))


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Linear:
    """The linear part of a description, ready to be asked for responses.

    Parameters
    ----------
    rows
        Coordinate that each sensor reads, relative to the base.
    orders
        How often the coordinate is differentiated.
    absolute
        1 for sensors in space, 0 for those relative to the base.
    scale
        From SI to the sensor's unit.
    """

    description: Description
    structure: Structure
    rows: Float[np.ndarray, "sensor dof"]
    orders: tuple[int, ...]
    absolute: Float[np.ndarray, " sensor"]
    scale: Float[np.ndarray, " sensor"]

    @classmethod
    def of(cls, description: Description) -> "Linear":
        """Take the linear part of a description; its effects are left out."""
        return cls._over(description, assemble(description))

    @classmethod
    def of_plant(cls, plant: Plant, values: Float[np.ndarray, " parameter"]) -> "Linear":
        """Take the linear part of a plant, with what its effects add to it.

        Hidden coordinates of effects come after those of the description; a factor of a sensor
        is one of its scale.
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
        )
        over = cls._over(with_values(plant.description, linear), structure)
        # What a sensor tells too much or too little, it tells of a force that is missing too.
        scale = over.scale.copy()
        for number, (effect, kind) in enumerate(zip(plant.effects, kinds, strict=True)):
            if kind.where == "sensor" and kind.is_factor:
                channel = [s.channel for s in plant.description.sensors].index(effect.place.id)
                scale[channel] *= named["effect", number, kind.names[0]]
        return dataclasses.replace(over, scale=scale)

    @classmethod
    def _over(cls, description: Description, structure: Structure) -> "Linear":
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
            orders=tuple(derivative_order(s.quantity) for s in description.sensors),
            absolute=np.array([float(s.frame == "absolute") for s in description.sensors]),
            scale=1.0 / np.array(factors),
        )

    def compliance(self, frequency_hz: Frequencies) -> Complex[np.ndarray, "frequency dof dof"]:
        """Displacement per force; zero where a structure that floats has none."""
        s = 2j * np.pi * frequency_hz[:, None, None]
        structure = self.structure
        stiffness = s**2 * structure.mass + s * structure.damping + structure.stiffness
        floats = np.linalg.matrix_rank(structure.stiffness) < structure.dofs
        held = np.where(frequency_hz > 0, 1.0, 0.0 if floats else 1.0)[:, None, None]
        safe = np.where(held > 0, stiffness, np.eye(structure.dofs))
        return np.asarray(held * np.linalg.inv(safe))

    def sensed(
        self,
        frequency_hz: Frequencies,
        displacement: Complex[np.ndarray, "frequency dof *more"],
    ) -> Complex[np.ndarray, "frequency sensor *more"]:
        """Give what the sensors tell of a motion relative to the base that has no beginning."""
        s = 2j * np.pi * frequency_hz
        gain = self.scale * s[:, None] ** np.array(self.orders)
        read = np.moveaxis(np.tensordot(self.rows, displacement, axes=(1, 1)), 0, 1)
        return np.asarray(gain.reshape(gain.shape + (1,) * (read.ndim - 2)) * read)

    def carried(self, frequency_hz: Frequencies) -> Complex[np.ndarray, "frequency sensor"]:
        """Give what the sensors tell of being carried along by the base, per m/s^2."""
        s = 2j * np.pi * np.where(frequency_hz > 0, frequency_hz, 1.0)[:, None]
        order = np.array(self.orders) - 2
        moving = (frequency_hz[:, None] > 0) | (order == 0)
        return np.asarray(np.where(moving, self.absolute * self.scale * s**order, 0.0))

    def free(
        self, samples: int, rate_hz: float, state: Float[np.ndarray, " state"]
    ) -> tuple[Float[np.ndarray, "time sensor"], Float[np.ndarray, "order time dof"]]:
        """Motion from an initial displacement and velocity: as sensed, and itself."""
        step = scipy.linalg.expm(state_matrix(self.structure) / rate_hz)
        whole = _followed(step, state, samples) @ self.by_state.T
        motion = whole.reshape(samples, 3, self.structure.dofs)
        sensed = [motion[:, order] @ self.rows[i] for i, order in enumerate(self.orders)]
        return np.stack(sensed, axis=1) * self.scale, np.asarray(np.moveaxis(motion, 1, 0))

    def free_spectra(
        self, frequency_hz: Frequencies, samples: int, rate_hz: float
    ) -> "FreeSpectra":
        r"""Transform `free` without making it: :math:`(I - E^N)(I - E z^{-1})^{-1}`."""
        step = scipy.linalg.expm(state_matrix(self.structure) / rate_hz)
        rest = np.eye(len(step))
        ended = rest - np.linalg.matrix_power(step, samples)
        back = np.exp(-2j * np.pi * frequency_hz / rate_hz)
        scale = np.full(len(frequency_hz), np.sqrt(2.0 / (rate_hz * samples)))
        scale[frequency_hz == 0] /= np.sqrt(2.0)
        scale[np.isclose(frequency_hz, rate_hz / 2)] /= np.sqrt(2.0)
        poles, modes = np.linalg.eig(step)
        # A motion that does not die has its pole on a line; one part in 1e9 moves it away.
        if np.linalg.cond(modes) < APART:
            gains = scale / (1 + 1e-9 - np.multiply.outer(poles, back))
            starts = np.linalg.solve(modes, ended)
            return FreeSpectra(self, modes + 0j, gains[:, :, None] * starts[:, None, :])
        inner = (1 + 1e-9) * rest - step * back[:, None, None]
        states = np.linalg.solve(inner, ended[None]) * scale[:, None, None]
        return FreeSpectra(self, rest + 0j, np.moveaxis(states, 1, 0))

    @property
    def by_state(self) -> Float[np.ndarray, "all state"]:
        """From a free state to displacements, velocities and accelerations."""
        dofs = self.structure.dofs
        inner = np.hstack([self.structure.stiffness, self.structure.damping])
        return np.vstack([np.eye(2 * dofs), -np.linalg.solve(self.structure.mass, inner)])

    def tuned(
        self,
        stiffness: Float[np.ndarray, "dof dof"],
        damping: Float[np.ndarray, "dof dof"],
        mass: Float[np.ndarray, "dof dof"],
    ) -> "Linear":
        """Add to the matrices."""
        structure = self.structure
        changed = dataclasses.replace(
            structure,
            stiffness=structure.stiffness + stiffness,
            damping=structure.damping + damping,
            mass=structure.mass + mass,
        )
        return dataclasses.replace(self, structure=changed)

    def sources(self) -> tuple[Source, ...]:
        """All places: elements, nodes, base, inputs, sensors."""
        return (
            *self._elements(),
            *self._nodes(),
            *self._base(),
            *self._inputs(),
            *self._sensors(),
        )

    def elongation(self, place: Place) -> Float[np.ndarray, " dof"]:
        """Coordinate along a place: second node minus first, or the node's own."""
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

    def _elements(self) -> list[Source]:
        places = [
            Place("element", e.id) for e in self.description.elements if isinstance(e, Spring)
        ]
        return [Source(place=p, force=-self.elongation(p)) for p in places]

    def _nodes(self) -> list[Source]:
        names = [n.id for n in self.description.nodes if n.id in self.structure.names]
        places = [Place("node", name) for name in names]
        return [Source(place=p, force=self.elongation(p)) for p in places]

    def _base(self) -> list[Source]:
        return [Source(place=Place("base", BASE), force=self.base_pull(), base=1.0)]

    def base_pull(self) -> Float[np.ndarray, " dof"]:
        """Force on each coordinate per m/s^2 of the base."""
        return np.asarray(self.structure.base_force(np.ones(1))[0])

    def _inputs(self) -> list[Source]:
        found = []
        for entry in self.description.inputs:
            place = Place("input", entry.channel)
            if entry.node is None:
                found.append(Source(place=place, force=self.base_pull(), base=1.0))
            else:
                force = self.elongation(Place("node", entry.node))
                found.append(Source(place=place, force=force))
        return found

    def _sensors(self) -> list[Source]:
        rest = np.zeros(self.structure.dofs)
        return [
            Source(place=Place("sensor", sensor.channel), force=rest, sensor=i)
            for i, sensor in enumerate(self.description.sensors)
        ]


def _followed(
    step: Float[np.ndarray, "state state"], state: Float[np.ndarray, " state"], samples: int
) -> Float[np.ndarray, "time state"]:
    """Follow a state from step to step, doubling how many are known."""
    known, ahead = state[None], step
    while len(known) < samples:
        known = np.concatenate([known, known @ ahead.T])
        ahead = ahead @ ahead
    return known[:samples]


def parameter_matrices(
    description: Description,
) -> dict[tuple[str, str], Float[np.ndarray, "dof dof"]]:
    """Matrix of each constant, by its name in a plant."""
    parts = assemble_parts(description)
    found = {("stiffness", name): part for name, part in parts.stiffness_parts.items()}
    found |= {("damping", name): part for name, part in parts.damping_parts.items()}
    return found | {("mass", name): part for name, part in parts.mass_parts.items()}

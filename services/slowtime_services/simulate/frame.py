"""A simulated shear frame whose storeys and floors change in slow time."""

import functools
import math
from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from slowtime.dynamics.builders import shear_frame
from slowtime.dynamics.damping import rayleigh_coefficients
from slowtime.dynamics.description import Description, assemble, assemble_parts
from slowtime.dynamics.modes import complex_modes, undamped_modes
from slowtime.dynamics.simulation import ambient_structure
from slowtime.dynamics.structure import Square, Structure
from slowtime.dynamics.transfer import frequency_response
from slowtime_schemas.quantities import Immutable

from .evolutions import Evolution, Unchanged, renewals
from .field_types import NotNegative, Positive
from .measurement import LASTING, EvolvingStructure, Record

Amounts = Annotated[tuple[Positive, ...], Field(min_length=1, max_length=12)]


class Machine(Immutable):
    """A machine that runs on one floor at a steady speed."""

    floor: str
    frequency_hz: Positive
    size: NotNegative = 1.0
    """Standard deviation of what its own floor's acceleration shows, in `acceleration_rms`."""


class SimulatedFrame(EvolvingStructure):
    """Rigid floors on storeys that sway, under ambient forces on all floors.

    Floors are ``floor1`` … from the lowest upwards, on ``storey1`` …; the dampers stay as
    built.

    Parameters
    ----------
    floors_kg, storeys_n_per_m
        As built: masses, and stiffnesses against sway.
    damping_ratio
        Of the lowest and of the highest mode as built; those between have a little less
        (Rayleigh damping).
    stiffness
        Storey → relative change in slow time; the others stay.
    mass
        Floor → relative change in slow time; the others stay.
    sensors
        Floors with an accelerometer; None for all. A channel is called ``a_`` and its floor.
    machine
        None where all is quiet.
    """

    kind: Literal["frame"] = "frame"
    floors_kg: Amounts = (1000.0, 1000.0, 800.0)
    storeys_n_per_m: Amounts = (1.2e6, 1.0e6, 0.8e6)
    damping_ratio: Annotated[float, Field(gt=0, lt=0.5)] = 0.01
    stiffness: dict[str, Evolution] = Field(default_factory=dict)
    mass: dict[str, Evolution] = Field(default_factory=dict)
    sensors: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    machine: Machine | None = None

    @model_validator(mode="after")
    def _knows_its_parts(self) -> "SimulatedFrame":
        floors = [node.id for node in self.description.nodes]
        storeys = [f"storey{i + 1}" for i in range(len(floors))]
        places = [*self.mass, *(self.sensors or ())]
        places += [self.machine.floor] if self.machine else []
        for given, known in ((self.stiffness, storeys), (places, floors)):
            for name in given:
                if name not in known:
                    raise ValueError(
                        f"{name!r} is no part of this frame. Name one of: {', '.join(known)}."
                    )
        return self

    @property
    def description(self) -> Description:
        """Frame as built, with its dampers, as it may be registered."""
        return _described(self.floors_kg, self.storeys_n_per_m, self.damping_ratio)

    @property
    def channels(self) -> tuple[str, ...]:
        """One acceleration a sensor."""
        return tuple(f"a_{floor}" for floor in self._floors_heard)

    def truth(self, epoch: int) -> dict[str, float]:
        """Return the true changes by part, and frequency and damping ratio of each mode.

        ``element.storey1`` …, ``node.floor1.mass`` … where it changes, ``mode.1.frequency_hz``,
        ``mode.1.damping_ratio`` …; of the lowest mode also without its number. With a
        temperature also ``lasting.element.storey1`` …, without what that does.
        """
        stiffness, mass = self._changes(epoch)
        known = {f"element.{name}": change for name, change in stiffness.items()}
        if self.temperature is not None:
            known |= {
                f"{LASTING}element.{name}": self._lasting(name, epoch) for name in stiffness
            }
        known |= {f"node.{name}.mass": mass[name] for name in self.mass}
        modes = complex_modes(self._structure(epoch))
        pairs = zip(modes.frequency_hz.tolist(), modes.damping_ratio.tolist(), strict=True)
        for number, (frequency, damping) in enumerate(pairs, start=1):
            known[f"mode.{number}.frequency_hz"] = frequency
            known[f"mode.{number}.damping_ratio"] = damping
        known["frequency_hz"] = known["mode.1.frequency_hz"]
        known["damping_ratio"] = known["mode.1.damping_ratio"]
        return known

    def renewals(self, epoch: int) -> int | None:
        """Return the number of renewals of storeys and floors before an epoch."""
        parts = (*self.stiffness.values(), *self.mass.values())
        return renewals(parts, epoch * self.slow_time_step)

    @property
    def _floors_heard(self) -> tuple[str, ...]:
        return self.sensors or tuple(node.id for node in self.description.nodes)

    def _highest_hz(self) -> float:
        omega = undamped_modes(assemble(self.description)).angular_frequency
        return float(omega[-1]) / (2 * math.pi)

    def _changes(self, epoch: int) -> tuple[dict[str, float], dict[str, float]]:
        """Relative change of every storey's stiffness and every floor's mass."""
        slow_time = epoch * self.slow_time_step
        parts = assemble_parts(self.description)
        stiffness = {
            name: self._warmed(self._lasting(name, epoch), epoch)
            for name in parts.stiffness_parts
        }
        mass = {
            name: self.mass.get(name, Unchanged()).at(slow_time) for name in parts.mass_parts
        }
        return stiffness, mass

    def _lasting(self, storey: str, epoch: int) -> float:
        return self.stiffness.get(storey, Unchanged()).at(epoch * self.slow_time_step)

    def _structure(self, epoch: int) -> Structure:
        stiffness, mass = self._changes(epoch)
        parts = assemble_parts(self.description)
        return Structure(
            mass=_weighted(parts.mass_parts, mass),
            damping=assemble(self.description).damping,
            stiffness=_weighted(parts.stiffness_parts, stiffness),
            names=parts.names,
        )

    def _force_psd(self) -> float:
        r"""Density of each floor's force that makes the sensors' mean square as asked for.

        Mode j of unit modal mass, under a force of density S on each floor, has the mean
        square acceleration :math:`S \, (X^T X)_{jj} \, \omega_j / 8 \zeta_j` near its
        resonance.
        """
        built = assemble(self.description)
        modes = undamped_modes(built)
        omega, shapes = modes.angular_frequency, modes.shapes
        twice = np.einsum("aj,ab,bj->j", shapes, built.damping, shapes)
        power = (shapes**2).sum(axis=0) * omega**2 / (4 * twice)
        heard = shapes[[built.dof(floor) for floor in self._floors_heard]]
        return self.acceleration_rms**2 / float((heard**2 @ power).mean())

    def _response(self, epoch: int, rng: np.random.Generator) -> Record:
        now = self._structure(epoch)
        heard = ambient_structure(
            now,
            self.samples,
            self.rate_hz,
            rng,
            force_psd=self._force_psd(),
            channels=self._floors_heard,
        )
        return heard if self.machine is None else heard + self._hum(self.machine, now, rng)

    def _hum(self, machine: Machine, now: Structure, rng: np.random.Generator) -> Record:
        """Waves that the machine makes the sensors show, at a phase of its own each epoch."""
        omega = 2 * math.pi * machine.frequency_hz
        own = now.dof(machine.floor)
        response = frequency_response(now, np.array([omega]), "acceleration")[0, :, own]
        amplitude = math.sqrt(2) * machine.size * self.acceleration_rms * response
        rows = [now.dof(floor) for floor in self._floors_heard]
        phase = omega * np.arange(self.samples) / self.rate_hz + rng.uniform(0, 2 * math.pi)
        wave = np.exp(1j * phase)[:, None] * (amplitude[rows] / abs(response[own]))
        return np.asarray(wave.real)


@functools.lru_cache(maxsize=64)
def _described(
    floors_kg: tuple[float, ...], storeys_n_per_m: tuple[float, ...], damping_ratio: float
) -> Description:
    bare = shear_frame(floors_kg, storeys_n_per_m)
    omega = undamped_modes(assemble(bare)).angular_frequency
    lowest, highest = float(omega[0]), float(omega[-1])
    damping = (0.0, 2 * damping_ratio / lowest)
    if highest > lowest:
        damping = rayleigh_coefficients((lowest, highest), (damping_ratio, damping_ratio))
    return shear_frame(floors_kg, storeys_n_per_m, rayleigh=damping, name="frame")


def _weighted(parts: Mapping[str, Square], changes: Mapping[str, float]) -> Square:
    """Sum of the parts, each changed in its own way."""
    return np.asarray(sum((1 + changes[name]) * part for name, part in parts.items()))

"""Simulation of a model under recorded inputs, at its sensors."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.description import BASE, Description, Input, Sensor, assemble
from slowtime.dynamics.effects import Kind, Unmeasured
from slowtime.dynamics.modes import undamped_modes
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.sdof.simulation import FORGOTTEN
from slowtime.dynamics.simulation import ambient_structure, simulate_structure
from slowtime.dynamics.structure import state_matrix
from slowtime.dynamics.transfer import QUANTITIES
from slowtime.dynamics.units import unit_factor
from slowtime.signals.interpolation import REACH

Series = Float[np.ndarray, " time"]
Motion = Float[np.ndarray, "time dof"]


def run_model(
    description: Description,
    inputs: Mapping[str, Series],
    rate_hz: float,
    *,
    hold: str = "first",
    kinds: Mapping[str, Kind] | None = None,
    start_s: float = 0.0,
    rng: np.random.Generator | None = None,
    samples: int | None = None,
) -> dict[str, Series]:
    """Run a model, its effects included, under measured inputs or from its start alone.

    The initial state is `description.initial`. Nodes that it does not name are at rest relative
    to the base, at the pseudo-static displacement that the supports give them.

    Parameters
    ----------
    inputs
        By channel, each in the unit that the model says.
    rate_hz
        Samples per second of all of them.
    hold
        What inputs do between samples, where the description does not say it: ``"first"``, go
        straight to the next; ``"zero"``, stay; ``"band_limited"``, be the signal without
        anything above half the sampling rate.
    kinds
        Of effect, by name; the catalogue where not given.
    start_s
        Campaign time of the first sample [s].
    rng
        Where motion of the base that nobody measured comes from.
    samples
        Length of a free decay [samples], for a model without inputs; None otherwise.

    Returns
    -------
    By channel, what each sensor measures in its unit, without noise.
    """
    if not description.inputs and samples is None:
        raise ValueError(
            "The model lists no inputs: it is under unmeasured ambient forces. Use "
            "ambient_model, list the inputs, or give `samples` for a free decay."
        )
    missing = [entry.channel for entry in description.inputs if entry.channel not in inputs]
    if missing:
        raise ValueError(
            f"The record has no channel called {', '.join(missing)}; it has "
            f"{', '.join(inputs)}. Name its channels as the model's inputs."
        )
    if _needs_plant(description, hold):
        plant = Plant.of(description, kinds=kinds, hold=hold)
        columns = [np.asarray(inputs[entry.channel], float) for entry in description.inputs]
        table = np.stack(columns, axis=1) if columns else np.zeros((samples or 0, 0))
        return run_plant(plant, table, rate_hz, start_s=start_s, rng=rng)
    structure = assemble(description)
    undamped_modes(structure)  # says so where the structure cannot stand
    coordinate = description.unit_of_coordinate
    length = len(inputs[description.inputs[0].channel])
    force, base = np.zeros((length, structure.dofs)), np.zeros(length)
    for entry in description.inputs:
        series = np.asarray(inputs[entry.channel], dtype=float)
        if entry.kind == "force":
            newtons = unit_factor(entry.unit, "force", coordinate) * series
            if entry.node in structure.names:
                force[:, structure.dof(entry.node)] += newtons
        else:
            base += unit_factor(entry.unit, "acceleration", coordinate) * series
    force += structure.base_force(base)
    relative = simulate_structure(structure, force, rate_hz, hold=hold)
    carried = base_motion(base, rate_hz, hold)
    return {
        sensor.channel: _measured(description, sensor, structure.names, relative, carried)
        for sensor in description.sensors
    }


def _needs_plant(description: Description, hold: str) -> bool:
    """Whether there is anything but forces and base accelerations on a linear structure."""
    plain = all(
        entry.hold is None and entry.kind in ("force", "base_acceleration")
        for entry in description.inputs
    )
    forces = any(sensor.quantity == "force" for sensor in description.sensors)
    more = description.effects or description.initial or description.moved or forces
    return bool(more) or not plain or hold == "band_limited"


def state_of(
    plant: Plant, inputs: Float[np.ndarray, "time input"], rate_hz: float
) -> Float[np.ndarray, " state"] | None:
    """Return the initial state that the description of a plant gives; None where it gives none.

    Parameters
    ----------
    inputs
        One column for each input of the description, in its unit.
    rate_hz
        Their sampling rate [Hz].

    Returns
    -------
    Displacements and velocities in the order of `Plant.state_names` (state,), in m and m/s, or
    rad and rad/s.
    """
    if not plant.description.initial:
        return None
    found = np.array(plant.run(plant.values, inputs[: 2 * REACH], rate_hz).states[0])
    names = list(plant.state_names)
    for start in plant.description.initial:
        found[names.index(("displacement", start.node))] = start.displacement_m
        found[names.index(("velocity", start.node))] = start.velocity_m_per_s
    return found


def ambient_model(
    description: Description,
    samples: int,
    rate_hz: float,
    seed: int,
    *,
    force_psd: float = 1.0,
    kinds: Mapping[str, Kind] | None = None,
) -> dict[str, Series]:
    """Run a model, stationary from the start, under white forces on all its nodes.

    With effects it is run in, for as long as the slowest of its linear modes takes to forget.
    The initial state of the description is not used.

    Parameters
    ----------
    samples, rate_hz
        Length and rate of the record.
    seed
        Decides every random number.
    force_psd
        One-sided, of the force on each node [N^2/Hz], in the model's own unit of force.
    kinds
        Of effect, by name; the catalogue where not given.
    """
    description = dataclasses.replace(description, initial=())
    if _needs_plant(description, "first"):
        return _ambient_plant(description, samples, rate_hz, seed, force_psd, kinds)
    structure = assemble(description)
    still = np.zeros(samples)
    # The same seed for each quantity: one set of forces, measured in several ways.
    listened = {sensor.quantity for sensor in description.sensors}
    motion = tuple(
        ambient_structure(
            structure,
            samples,
            rate_hz,
            np.random.default_rng(seed),
            force_psd=force_psd,
            quantity=quantity,
        )
        if quantity in listened
        else np.zeros((samples, structure.dofs))
        for quantity in QUANTITIES
    )
    return {
        sensor.channel: _measured(description, sensor, structure.names, motion, (still,) * 3)
        for sensor in description.sensors
    }


def base_motion(
    acceleration: Series, rate_hz: float, hold: str = "first"
) -> tuple[Series, Series, Series]:
    """Displacement, velocity and acceleration of a base that starts from rest."""
    step = 1.0 / rate_hz
    now, then = acceleration[:-1], acceleration[1:]
    if hold == "zero":
        then = now
    velocity = np.concatenate([[0.0], np.cumsum(step / 2 * (now + then))])[: len(acceleration)]
    moved = step * velocity[:-1] + step**2 / 6 * (2 * now + then)
    displacement = np.concatenate([[0.0], np.cumsum(moved)])[: len(acceleration)]
    return displacement, velocity, acceleration


def _measured(
    description: Description,
    sensor: Sensor,
    names: tuple[str, ...],
    relative: tuple[Motion, ...],
    base: tuple[Series, ...],
) -> Series:
    order = QUANTITIES.index(sensor.quantity)
    motion = np.zeros(len(base[order]))
    # A node that is held, as at a pin, and the base itself do not move against the base.
    if sensor.node != BASE and sensor.node in names:
        motion = relative[order][:, names.index(sensor.node)]
    if sensor.frame == "absolute":
        motion = motion + base[order]
    factor = unit_factor(sensor.unit, sensor.quantity, description.unit_of_coordinate)
    return np.asarray(motion / factor)


def run_plant(
    plant: Plant,
    inputs: Float[np.ndarray, "time input"],
    rate_hz: float,
    *,
    start_s: float,
    rng: np.random.Generator | None,
) -> dict[str, Series]:
    """Run a plant as described; unmeasured motion of the base is drawn at random.

    Raises
    ------
    ValueError
        Where the motion grows beyond bounds, and where something random lacks its `rng`.
    """
    sizes = [
        effect.parameters["rms_m_per_s2"]
        for effect in plant.effects
        if isinstance(plant.kinds[effect.kind].action, Unmeasured)
    ]
    base = None
    if sizes:
        if rng is None:
            raise ValueError(
                "The model has an unmeasured motion of the base, which is random. Give a seed."
            )
        base = np.hypot.reduce(sizes) * rng.standard_normal(len(inputs))
    found = plant.run(
        plant.values,
        inputs,
        rate_hz,
        state0=state_of(plant, inputs, rate_hz),
        start_s=start_s,
        base=base,
    )
    if found.steps < 0:
        raise ValueError(
            f"The motion grows beyond bounds after {-found.steps / rate_hz:g} s: the model is "
            "unstable there. Check the sign and size of its effects."
        )
    sensors = plant.description.sensors
    return {
        sensor.channel: column for sensor, column in zip(sensors, found.outputs.T, strict=True)
    }


def _ambient_plant(
    description: Description,
    samples: int,
    rate_hz: float,
    seed: int,
    force_psd: float,
    kinds: Mapping[str, Kind] | None,
) -> dict[str, Series]:
    structure = assemble(description)
    slowest = -float(np.linalg.eigvals(state_matrix(structure)).real.max())
    if slowest <= 0:
        raise ValueError(
            "A motion that does not die away never becomes stationary under ambient force. "
            "Give every element damping."
        )
    pushed = [node for node in description.nodes if node.id in structure.names]
    forces = tuple(
        Input(
            channel=node.id,
            kind="force",
            node=node.id,
            unit="N m" if description.unit_of_coordinate == "rad" else "N",
        )
        for node in pushed
    )
    rng = np.random.default_rng(seed)
    before = math.ceil(FORGOTTEN / slowest * rate_hz)
    white = rng.standard_normal((before + samples, len(forces)))
    plant = Plant.of(
        dataclasses.replace(description, inputs=forces), kinds=kinds, hold="band_limited"
    )
    run = run_plant(
        plant,
        math.sqrt(force_psd * rate_hz / 2) * white,
        rate_hz,
        start_s=-before / rate_hz,
        rng=rng,
    )
    return {channel: series[before:] for channel, series in run.items()}

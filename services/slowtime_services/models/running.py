"""A model set in motion: inputs in, what its sensors would have measured out."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.description import BASE, Description, Sensor, assemble
from slowtime.dynamics.simulation import ambient_structure, simulate_structure
from slowtime.dynamics.transfer import QUANTITIES
from slowtime.dynamics.units import unit_factor

Series = Float[np.ndarray, " time"]
Motion = Float[np.ndarray, "time dof"]


def run_model(
    description: Description,
    inputs: Mapping[str, Series],
    rate_hz: float,
    *,
    hold: str = "first",
) -> dict[str, Series]:
    """Run a model from rest under measured inputs.

    Parameters
    ----------
    inputs
        By channel, each in the unit that the model says.
    rate_hz
        Samples per second of all of them.
    hold
        What inputs do between samples: ``"first"``, go straight to the next; ``"zero"``, stay.

    Returns
    -------
    By channel, what each sensor measures in its unit, without noise.
    """
    _refuse_effects(description)
    if not description.inputs:
        raise ValueError(
            "The model lists no inputs: it is under ambient forces that nobody measured. Use "
            "ambient_model, or list the inputs."
        )
    missing = [entry.channel for entry in description.inputs if entry.channel not in inputs]
    if missing:
        raise ValueError(
            f"The record has no channel called {', '.join(missing)}; it has "
            f"{', '.join(inputs)}. Name its channels as the model's inputs."
        )
    structure = assemble(description)
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


def ambient_model(
    description: Description,
    samples: int,
    rate_hz: float,
    seed: int,
    *,
    force_psd: float = 1.0,
) -> dict[str, Series]:
    """Run a model, stationary from the start, under white forces on all its nodes.

    Parameters
    ----------
    samples, rate_hz
        Length and rate of the record.
    seed
        Decides every random number.
    force_psd
        One-sided, of the force on each node [N^2/Hz], in the model's own unit of force.
    """
    _refuse_effects(description)
    structure = assemble(description)
    still = np.zeros(samples)
    # The same seed for each quantity: one set of forces, heard in several ways.
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


def _refuse_effects(description: Description) -> None:
    if description.effects:
        names = ", ".join(str(effect.get("effect")) for effect in description.effects)
        raise ValueError(
            f"The model has effects that this version cannot run: {names}. Linear nodes and "
            "elements only; take `effects` out to run the linear part."
        )

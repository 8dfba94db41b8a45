"""A plant that is advanced from one communication point to the next.

In co-simulation the inputs are known up to the present instant only. They keep their values
over a step (zero-order hold), so that the steps of a linear plant are exact.
"""

import dataclasses
import math

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.effects import InputChange, SensorChange, Unmeasured

from .kernel import FIRST_OBSERVATION, FRICTION
from .parameter_names import Name
from .plant import Plant
from .sensing import sensor_readouts

Values = Float[np.ndarray, " parameter"]
Outputs = Float[np.ndarray, " sensor"]
State = Float[np.ndarray, " state"]

PROBES = 5
"""Instants within the first seconds at which a change of a channel is looked at."""

STILL = 1e-9
"""Sliding speed over the largest velocity so far [1] up to which friction sticks; rounding of
sticking is below 1e-12, and slower sliding changes no motion that can be told."""

NEAR_S = 0.01
"""Time after an instant of an effect at which it is looked at as well [s]."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class CommunicationPoint:
    """A plant at a communication point.

    Parameters
    ----------
    state
        In the order of `Plant.state_names`, in SI units.
    base
        Displacement [m] and velocity [m/s] of the base.
    time_s
        Campaign time [s].
    largest_speed
        Largest velocity of a coordinate so far, in SI units.
    """

    state: State
    base: Float[np.ndarray, "2"]
    time_s: float
    largest_speed: float


def check_co_simulation(plant: Plant) -> None:
    """Refuse a plant that cannot be advanced without knowledge of later inputs.

    Raises `ValueError`, naming the input or effect that needs a whole record, and what to do.
    """
    description = plant.description
    if not description.inputs and not description.initial:
        raise ValueError(
            f"{description.name} has neither inputs nor an initial state, so nothing moves "
            "it. List its forces or the acceleration of its base under `inputs`."
        )
    for entry in description.inputs:
        if entry.kind not in ("force", "base_acceleration"):
            raise ValueError(
                f"Input {entry.channel!r} is a {entry.kind.replace('_', ' ')}, which has to be "
                "differentiated and jumps under a zero-order hold. Allowed: force, "
                "base_acceleration."
            )
    for entry in description.inputs:
        if entry.hold not in (None, "zero"):
            raise ValueError(
                f"Input {entry.channel!r} has `hold: {entry.hold}`, which needs samples to "
                "come. Leave it out: inputs keep their values during a step."
            )
    _check_effects(plant)
    for name, value in zip(plant.entries, plant.values.tolist(), strict=True):
        if math.isnan(value):
            raise ValueError(
                f"`{name[-1]}` is not given and means the end of the record, which "
                "co-simulation does not have. Give an instant in seconds."
            )


def _check_effects(plant: Plant) -> None:
    moved = [
        sensor.channel
        for sensor, readout in zip(
            plant.description.sensors,
            sensor_readouts(plant.description, plant.matrices.names),
            strict=True,
        )
        if readout.absolute and readout.order < 2
    ]
    shaken = any(one.kind == "base_acceleration" for one in plant.description.inputs)
    for effect in plant.effects:
        action = plant.kinds[effect.kind].action
        if isinstance(action, Unmeasured):
            raise ValueError(
                f"Effect {effect.kind} is a motion of the base that nobody measured. Add an "
                "input of kind base_acceleration in its place."
            )
        if not isinstance(action, InputChange | SensorChange):
            continue
        own = plant.kinds[effect.kind].values(dict(effect.parameters))
        if not _is_memoryless(action, own):
            raise ValueError(
                f"Effect {effect.kind} on {effect.place.id!r} needs earlier or later samples. "
                "Leave it out, and apply it to the signal outside."
            )
        if shaken and effect.place.id in moved:
            raise ValueError(
                f"Effect {effect.kind} on {effect.place.id!r} changes a sensor that moves "
                "along with the base. Leave it out, or set `frame: relative_to_base`."
            )


def _is_memoryless(action: InputChange | SensorChange, own: Float[np.ndarray, " own"]) -> bool:
    """Whether each sample depends on the sample of the same instant alone."""
    instants = own[np.isfinite(own)]
    # Parameters may be instants from which on something happens.
    times = np.unique([*np.linspace(0.0, 2.0, PROBES), *instants, *(instants + NEAR_S)])
    series = np.cos(np.arange(1.0, len(times) + 1) ** 2)
    plain = action.act(series, times, own)
    for k in range(len(times)):
        moved = series.copy()
        moved[k] += 1.0
        if np.delete(action.act(moved, times, own) != plain, k).any():
            return False
    return True


def starting_instant(plant: Plant, state: State | None, time_s: float) -> CommunicationPoint:
    """Return the first communication point.

    The state is at rest where None, and the base rests.
    """
    found = np.zeros(len(plant.state_names)) if state is None else np.array(state, dtype=float)
    return CommunicationPoint(found, np.zeros(2), time_s, _speed(plant, found))


def outputs_at(
    plant: Plant, values: Values, now: CommunicationPoint, inputs: Float[np.ndarray, " input"]
) -> Outputs:
    """Compute what the sensors measure at an instant."""
    run = plant.run(values, inputs[None], 1.0, state0=now.state, start_s=now.time_s)
    outputs = np.asarray(run.outputs[0])
    readouts = sensor_readouts(plant.description, plant.matrices.names)
    for k, readout in enumerate(readouts):
        if readout.absolute and readout.order < 2:
            outputs[k] += readout.factor * now.base[readout.order]
    return outputs


def advanced(
    plant: Plant,
    values: Values,
    now: CommunicationPoint,
    inputs: Float[np.ndarray, " input"],
    step_s: float,
) -> CommunicationPoint:
    """Advance a plant by one step, over which its inputs keep their values.

    Inputs are those from `now` on, in the units of the description. Raises `ValueError` where
    the step has no length, and `ArithmeticError` where the motion grows beyond bounds.
    """
    if not 0 < step_s < math.inf:
        raise ValueError(f"{step_s=} is no length of a step. Give seconds, above 0.")
    run = plant.run(
        values,
        np.stack([inputs, inputs]),
        1.0 / step_s,
        state0=now.state,
        start_s=now.time_s,
    )
    if run.steps < 0 or not np.isfinite(run.states[-1]).all():
        raise ArithmeticError(
            f"The motion grows beyond bounds after {now.time_s:g} s. Check the sign and size "
            "of the effects and parameters."
        )
    shaken, (displacement, velocity) = float(run.base[0]), now.base
    base = np.array(
        [displacement + step_s * (velocity + step_s / 2 * shaken), velocity + step_s * shaken]
    )
    state = run.states[-1].copy()
    largest = max(now.largest_speed, _speed(plant, state))
    _set_sticking(plant, state, STILL * largest)
    return CommunicationPoint(state, base, now.time_s + step_s, largest)


def _speed(plant: Plant, state: State) -> float:
    free = len(plant.matrices.names)
    return float(np.abs(state[free : 2 * free]).max(initial=0.0))


def _set_sticking(plant: Plant, state: State, still: float) -> None:
    """Set the sliding speed of friction that sticks to exactly zero, in place."""
    # A run begins with sliding where a speed is not zero, and speeds of sticking are rounding.
    for row in plant.layout.table:
        if not row[FRICTION]:
            continue
        seen = plant.layout.seeing[row[FIRST_OBSERVATION] + 1, : len(state)]
        speed = float(seen @ state)
        if abs(speed) <= still:
            last = np.flatnonzero(seen)[-1]
            state[last] -= speed / seen[last]


def adjustable(plant: Plant) -> tuple[Name, ...]:
    """Return the names of the parameters that may change between steps."""
    return tuple(name for name, entry in plant.entries.items() if entry.fitted)

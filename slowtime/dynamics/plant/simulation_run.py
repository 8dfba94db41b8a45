"""One simulation run of a plant: inputs, matrices, time stepping, sensors."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from slowtime.dynamics.channels import BASE_KINDS
from slowtime.dynamics.description import Description, Spring
from slowtime.dynamics.effects import Effect, Kind, Motion, Place
from slowtime.dynamics.effects.compilation import ROUND
from slowtime.dynamics.work import count_simulation

from .boundary import (
    add_prescribed_friction,
    named_rows,
    prescribed_friction,
    pseudo_static,
)
from .imposed import Driven, differentiations, driven_by
from .kernel import KernelArrays, Workspace, has_events, memory_table, padded_count, simulate
from .matrices import MatrixParts
from .parameter_names import Name
from .sensing import (
    SensorReadout,
    acting,
    add_record_offsets,
    apply_sensor_effects,
    base_of,
    sensor_readouts,
)
from .system import Layout
from .system_cache import Settings, is_linear, system_of

TOLERANCE = 3e-4
"""By how much the parabola of a force may miss the force at the beginning of a step, over the
largest so far; what that does to the motion is some hundred times less."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlantRun:
    """What a run was.

    Parameters
    ----------
    outputs
        Of the sensors, in their units.
    slopes
        Of the outputs: to each free parameter, then to each number of the first state; None
        where they were not requested.
    states, rates
        Of the structure in SI; and how fast they change.
    supports
        By name, displacement, velocity and acceleration of what inputs move, against the base.
    forces
        Of laws, and rates of what they remember.
    steps
        How many were taken, those tried in vain too; negative where the motion grew beyond
        bounds.
    """

    outputs: Float[np.ndarray, "time sensor"]
    slopes: Float[np.ndarray, "time sensor slope"] | None
    states: Float[np.ndarray, "time state"]
    rates: Float[np.ndarray, "time state"]
    supports: Mapping[str, Float[np.ndarray, "order time"]]
    forces: Float[np.ndarray, "time channel"]
    base: Float[np.ndarray, " time"]
    times: Float[np.ndarray, " time"]
    steps: int


def run(
    description: Description,
    effects: Sequence[Effect],
    kinds: Sequence[Kind],
    matrices: MatrixParts,
    layout: Layout,
    values: Mapping[Name, float],
    inputs: Float[np.ndarray, "time input"],
    rate_hz: float,
    free: Sequence[Name] | None,
    *,
    state0: Float[np.ndarray, " state"] | None,
    start_s: float,
    base: Float[np.ndarray, " time"] | None,
    hold: str,
) -> PlantRun:
    """Simulate a plant; see `Plant.run`.

    Values are by name; NaN stands for the end of the record. Outputs are NaN from where the
    motion grew beyond bounds.
    """
    samples, interval = len(inputs), 1 / rate_hz
    times = start_s + np.arange(samples) / rate_hz
    # Not-a-number stands for the end of the record.
    values = {name: times[-1] if math.isnan(v) else v for name, v in values.items()}
    parameters = tuple(free or ())
    acting_inputs, driven = acting(
        description, effects, kinds, values, inputs, times, parameters
    )
    if base is not None:
        acting_inputs = np.concatenate([acting_inputs, base[:, None]], axis=1)
    columns = np.concatenate(
        [acting_inputs, *(series[:, None] for _, _, series in driven)], axis=1
    )
    holds = [entry.hold or hold for entry in description.inputs]
    holds += [hold] * (acting_inputs.shape[1] - len(holds))
    holds += [holds[column] for _, column, _ in driven]
    differentiated = [*differentiations(description), *((0,) if base is not None else ())]
    differentiated += [differentiated[column] for _, column, _ in driven]
    moving = driven_by(columns, holds, differentiated, interval)
    coefficients = moving.coefficients
    settings = Settings(
        layout=layout,
        matrices=matrices,
        kinds=tuple(kinds),
        values=tuple(values.items()),
        linear=tuple(name for name in parameters if is_linear(name, matrices)),
        laws=tuple(name for name in parameters if name in layout.law_names),
        driven=tuple((name, column) for name, column, _ in driven),
        interval=interval,
        powers=coefficients.shape[2],
        unmeasured=base is not None,
    )
    system, order = system_of(settings), settings.order
    slopes = len(order) + layout.free if free is not None else 0
    start = _support_start(description, layout, moving.start, driven, order)
    start[: layout.free] = _carried_state(settings, start) if state0 is None else 0.0
    if state0 is not None:
        start[: layout.free, 0] = state0
    free_count = len(matrices.names)
    readouts = sensor_readouts(description, matrices.names)
    workspace = _workspace(
        system,
        start[:, 0],
        len(order),
        slopes,
        coefficients.shape[1],
        _read_rows(readouts, free_count, layout),
    )
    if slopes:
        workspace.state_slopes[:, : len(order)] = start[:, 1:]
    states, rates = (np.full((samples, layout.states), np.nan) for _ in range(2))
    forces = np.full((samples, layout.channels), np.nan)
    factors = np.array([readout.factor for readout in readouts])
    # By sensor first, so that the slopes of one sensor are contiguous in memory.
    output_slopes = np.zeros(
        (len(readouts), samples, len(parameters) + layout.free if free is not None else 0)
    )
    slope_columns = [parameters.index(name) for name in order]
    slope_columns += range(len(parameters), len(parameters) + layout.free)
    steps = simulate(
        memory_table(system, workspace),
        has_events(system),
        coefficients,
        start_s,
        interval,
        TOLERANCE,
        states,
        rates,
        forces,
        _read_rows(readouts, free_count, layout),
        factors,
        np.array(slope_columns[:slopes], dtype=np.int64),
        output_slopes,
    )
    count_simulation(abs(int(steps)), layout.states * (1 + slopes))
    if steps < 0:
        output_slopes[:, -steps:] = np.nan
    base_motion, from_rest, base_parameters = _base(
        description, moving, driven, base is not None
    )
    ground = (
        base_of(base_motion, interval, from_rest).motion
        if any(readout.absolute for readout in readouts)
        else ()
    )
    outputs = np.zeros((samples, len(readouts)))
    for k, readout in enumerate(readouts):
        row = readout.row(free_count, *_sizes(layout))
        if row is not None:
            outputs[:, k] = (states if readout.order < 2 else rates)[:, row]
        if readout.absolute:
            outputs[:, k] += ground[readout.order][:, 0]
            for i, name in enumerate(base_parameters if slopes else ()):
                output_slopes[k, :, parameters.index(name)] += (
                    factors[k] * ground[readout.order][:, 1 + i]
                )
    outputs *= factors
    slopes_by_time = output_slopes.transpose(1, 0, 2)
    at = {name: j for j, name in enumerate(parameters)}
    found = PlantRun(
        outputs=outputs,
        slopes=slopes_by_time if free is not None else None,
        states=states[:, : layout.free],
        rates=rates[:, : layout.free],
        supports=_supports(matrices.moved, states, rates, layout),
        forces=forces,
        base=base_motion[:, 0, 0],
        times=times,
        steps=int(steps),
    )
    if prescribed_friction(description, effects, kinds):
        moved = motions(description, matrices.names, found)
        add_prescribed_friction(
            description, effects, kinds, values, moved, outputs, slopes_by_time, at, factors
        )
    apply_sensor_effects(
        description, effects, kinds, values, outputs, times, slopes_by_time, at
    )
    add_record_offsets(
        description, effects, kinds, values, free_count, states, outputs, slopes_by_time,
        len(parameters),
    )  # fmt: skip
    return found


def motions(
    description: Description, names: Sequence[str], found: PlantRun
) -> dict[Place, Motion]:
    """Motion of every spring element, and of every node that moves: see `Plant.states`."""
    free = len(names)
    rows = found.states[:, :free], found.states[:, free : 2 * free], found.rates
    whole = np.stack([rows[0], rows[1], rows[2][:, free : 2 * free]])
    moved = {name: whole[:, :, k] for k, name in enumerate(names)} | dict(found.supports)
    still, seen = np.zeros((3, len(found.times))), {}
    for part in description.elements:
        if not isinstance(part, Spring):
            continue
        first, second = (moved.get(name, still) for name in part.between)
        e, v, a = second - first
        seen["element", part.id] = Motion(e=e, v=v, a=a, times=found.times)
    for node in description.nodes:
        if node.id in moved:
            e, v, a = moved[node.id]
            seen["node", node.id] = Motion(e=e, v=v, a=a + found.base, times=found.times)
    return {Place(kind, name): motion for (kind, name), motion in seen.items()}  # type: ignore[arg-type]


def _sizes(layout: Layout) -> tuple[int, int, int]:
    """Count states, supports, and measured forces."""
    return layout.states, layout.support_states // 2, len(layout.shares)


def _supports(
    names: Sequence[str],
    states: Float[np.ndarray, "time state"],
    rates: Float[np.ndarray, "time state"],
    layout: Layout,
) -> dict[str, Float[np.ndarray, "order time"]]:
    """Displacement, velocity and acceleration of what inputs move, against the base."""
    at, _, gauges = layout.free, *_sizes(layout)[1:]
    velocities = named_rows(states, names, gauges)
    accelerations = named_rows(rates, names, gauges)
    return {
        name: np.stack([states[:, at + k], velocities[name], accelerations[name]])
        for k, name in enumerate(names)
    }


def _support_start(
    description: Description,
    layout: Layout,
    start: Float[np.ndarray, "2 input"],
    driven: Sequence[tuple[Name, int, Float[np.ndarray, " time"]]],
    order: Sequence[Name],
) -> Float[np.ndarray, "state slope"]:
    """First displacements and velocities of supports against the base, then their slopes."""
    found = np.zeros((layout.states, 1 + len(order)))
    states, moved, gauges = _sizes(layout)
    rows = np.stack([np.arange(moved), moved + np.arange(moved)]) + layout.free
    assert rows.size + layout.free + gauges == states
    moving = list(layout.apart)
    inputs = len(description.inputs)
    first = start.shape[1] - len(driven)
    columns = [(0, k, k) for k in range(inputs)]
    columns += [
        (1 + order.index(name), column, first + i) for i, (name, column, _) in enumerate(driven)
    ]
    for to, column, source in columns:
        support = layout.supports[column]
        if support is not None:
            found[rows[:, support], to] += start[:, source]
        elif description.inputs[column].kind in BASE_KINDS and moving:
            found[rows[:, moving], to] -= start[:, source, None]
    return found


def _carried_state(
    settings: Settings, start: Float[np.ndarray, "state slope"]
) -> Float[np.ndarray, "free_state slope"]:
    """State of a structure that its supports carry along as if it had no mass, and slopes."""
    layout, matrices = settings.layout, settings.matrices
    found = np.zeros((layout.free, start.shape[1]))
    if start.any():
        values, kinds = dict(settings.values), list(settings.kinds)
        free, moved = len(matrices.names), layout.support_states // 2
        stiffness = [matrices.at(values, kinds)[2]]
        stiffness += [matrices.slope(name, values, kinds)[2] for name in settings.linear]
        shapes = pseudo_static(np.array(stiffness), free, moved)
        for order in range(2):
            rows = slice(layout.free + order * moved, layout.free + (order + 1) * moved)
            to = slice(order * free, (order + 1) * free)
            found[to] = shapes[0] @ start[rows]
            found[to, 1 : len(shapes)] += (shapes[1:] @ start[rows, 0]).T
    return found


def _workspace(
    system: KernelArrays,
    state0: Float[np.ndarray, " states"],
    before: int,
    slopes: int,
    inputs: int,
    read: Int[np.ndarray, "sensor 2"],
) -> Workspace:
    size, channels, seen = len(state0), len(system.laws), len(system.observation)
    rows, columns = system.step_matrices.shape[1], system.step_matrices.shape[2]
    powers = (columns - size - 3 * channels) // max(
        system.rate_matrix.shape[1] - size - channels, 1
    )
    wide = padded_count(slopes)
    slope = np.zeros((size, wide))
    if slopes:
        slope[:, before:slopes] = np.eye(size, slopes - before)
    speeds = system.observation @ state0
    modes = [np.sign(speeds[row[2] + 1]) if row[0] else 0.0 for row in system.effect_table]
    widest = int(max([2, *(max(2 + row[3], row[5]) for row in system.effect_table)]))
    frictions = int(system.effect_table[:, 0].sum())
    needed = np.zeros(size, dtype=np.int64)
    needed[np.flatnonzero((system.observation != 0.0).any(axis=0))] = 1
    needed[read[(read[:, 0] >= 0) & (read[:, 1] == 1), 0]] = 1
    return Workspace(
        state=padded_copy(np.asarray(state0, dtype=float)),
        state_slopes=slope,
        modes=np.array(modes, dtype=float),
        largest_forces=np.zeros(channels),
        largest_observed=np.zeros(seen),
        combined=np.zeros((system.rate_matrix.shape[1], 1)),
        combined_slopes=np.zeros((system.rate_matrix.shape[1], wide)),
        rate=padded_copy(np.zeros(size))[:, None],
        rate_slopes=np.zeros((size, wide)),
        observed=padded_copy(np.zeros(seen)),
        observed_slopes=np.zeros((seen, wide)),
        friction_limits=np.zeros((channels, 1)),
        observation_derivatives=np.zeros((3, channels, widest)),
        parameter_derivatives=np.zeros((channels, widest)),
        step_vector=np.zeros(columns),
        step_result=padded_copy(np.zeros(rows)),
        step_result_slopes=np.zeros((rows, wide)),
        point_forces=np.zeros(3 * channels),
        point_observed=padded_copy(np.zeros(3 * seen)).reshape(3, seen),
        jacobian=np.zeros((3 * channels, 3 * channels)),
        inverse_jacobian=np.zeros((3 * channels, 3 * channels)),
        right_side=np.zeros((3 * channels, 1)),
        right_side_slopes=np.zeros((3 * channels, wide)),
        part_coefficients=np.zeros((inputs, powers)),
        sticking_matrix=np.zeros((frictions, frictions)),
        sticking_right_side=np.zeros((frictions, 1)),
        sticking_slopes=np.zeros((frictions, wide)),
        stage_state=np.zeros(size),
        stage_slopes=np.zeros((size, wide)),
        next_state=np.zeros(size),
        next_slopes=np.zeros((size, wide)),
        rate_before=np.zeros(size),
        instant_slopes=np.zeros(wide),
        linear_slope_product=np.zeros(
            max(system.step_matrix_slopes.shape[2], system.rate_matrix_slopes.shape[1])
        ),
        zeros=np.zeros(ROUND),
        needed_rates=needed,
    )


def padded_copy(values: Float[np.ndarray, " number"]) -> Float[np.ndarray, " number"]:
    """Copy numbers into an array that is padded to whole rounds."""
    found = np.zeros(padded_count(len(values)) + ROUND)[: len(values)]
    found[:] = values
    return found


def _read_rows(
    readouts: Sequence[SensorReadout], dofs: int, layout: Layout
) -> Int[np.ndarray, "sensor 2"]:
    """Index of the state, or with a 1 behind it of its rate, that each sensor measures."""
    rows = [(readout.row(dofs, *_sizes(layout)), readout.order) for readout in readouts]
    return np.array(
        [(-1, 0) if row is None else (row, int(order == 2)) for row, order in rows],
        dtype=np.int64,
    ).reshape(-1, 2)


def _base(
    description: Description,
    moving: Driven,
    driven: Sequence[tuple[Name, int, Float[np.ndarray, " time"]]],
    unmeasured: bool,
) -> tuple[Float[np.ndarray, "time power slope"], Float[np.ndarray, "2 slope"], list[Name]]:
    """Base's acceleration, then its slopes: polynomials, the start, and names of slopes."""
    coefficients = moving.coefficients
    base_parameters = [
        k for k, entry in enumerate(description.inputs) if entry.kind in BASE_KINDS
    ]
    count = len(description.inputs) + unmeasured
    moved = [
        (i, name) for i, (name, column, _) in enumerate(driven) if column in base_parameters
    ]
    found = np.zeros((len(coefficients), coefficients.shape[2], 1 + len(moved)))
    start = np.zeros((2, 1 + len(moved)))
    for k in (*base_parameters, *((count - 1,) if unmeasured else ())):
        found[:, :, 0] += coefficients[:, k]
        start[:, 0] += moving.start[:, k]
    for at, (i, _) in enumerate(moved):
        found[:, :, 1 + at] = coefficients[:, count + i]
        start[:, 1 + at] = moving.start[:, count + i]
    return found, start, [name for _, name in moved]

"""Sensors that sit at another node than the model says: one moved, or two exchanged.

Free runs of the model as given are compared with each channel at each node. An arrangement that
leaves far less is fitted; it is taken where the fit, too, leaves far less.
"""

import dataclasses
import itertools
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.description import Description, Sensor
from slowtime.dynamics.effects import Effect, Kind, Place
from slowtime.dynamics.plant import Plant

from .calibration import Fit, try_refit
from .candidates.library_fit import MISPLACED
from .diagnosis import Diagnosis, GapStep, NamedEffect, Number
from .records import Trial
from .report.evaluation import described
from .validation.free_run import evaluate_free_run

SUGGESTED_SHARE = 0.7
"""[share of the mean square left] Up to which an arrangement is fitted. Source: a decision: a
needless fit costs computing time alone."""
TAKEN_SHARE = 0.1
"""[share of what is missing] That an arrangement leaves at most. Source: as for a clock that is
off, of which the twin is 0.01; another effect may be missing beside it."""
MOST_READINGS = 200
"""[readings] Of sensors at nodes that are simulated. Source: a bound on computing time."""

Moves = Mapping[int, str]
"""Number of a sensor → the node that it sits at."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Rewiring:
    """Sensors that sit elsewhere, and the fit of the model as given."""

    description: Description
    moves: Moves
    given: Fit


def find_rewiring(
    description: Description, trials: Sequence[Trial], kinds: Mapping[str, Kind]
) -> Rewiring | None:
    """Find the sensors that sit at another node; None where none does."""
    nodes = [node.id for node in description.nodes if node.id in description.dofs]
    sensors = description.sensors
    if all(one.quantity == "force" for one in sensors):
        return None
    if MISPLACED not in kinds or len(nodes) < 2 or len(nodes) * len(sensors) > MOST_READINGS:
        return None
    left = _left(description, trials[0], kinds, nodes)
    if not np.isfinite(left).all():
        return None
    own = sum(left[i][nodes.index(s.node)] for i, s in enumerate(sensors) if s.node in nodes)
    ranked = sorted(
        ((_gained(left, nodes, sensors, moves), moves) for moves in _moves(sensors, nodes)),
        key=lambda one: -one[0],
    )
    if not ranked or ranked[0][0] < (1 - SUGGESTED_SHARE) * own:
        return None
    moved = _moved(description, ranked[0][1])
    given, other = (
        try_refit(Plant.of(one, kinds=kinds), trials) for one in (description, moved)
    )
    if given is None or other is None:
        return None
    before, after = (fit.chi2_in_band - 1.0 for fit in (given, other))
    # Noise is that of the better fit: each fit estimates its own.
    if not after < TAKEN_SHARE * before:
        return None
    return Rewiring(moved, ranked[0][1], given)


def with_rewiring(
    answer: Diagnosis, found: Rewiring, given: Description, tests: Sequence[Trial]
) -> Diagnosis:
    """Tell a diagnosis of the corrected model as one of the model as given."""
    named = tuple(_named(given, i, node) for i, node in found.moves.items())
    as_given = dataclasses.replace(found.given, values=found.given.plant.values)
    nominal = evaluate_free_run(given, as_given, tests)
    refitted = evaluate_free_run(described(found.given), found.given, tests)
    steps = (
        GapStep(MISPLACED, named[-1].effect.place, answer.gap.refitted_nominal),
        *answer.gap.steps,
    )
    gap = dataclasses.replace(
        answer.gap,
        nominal=float(nominal.error.mean()),
        refitted_nominal=float(refitted.error.mean()),
        steps=steps,
    )
    alone = answer.verdict in ("nothing_missing", "parameters_only")
    told = " ".join(one.sentence for one in named)
    return dataclasses.replace(
        answer,
        verdict="sensor_fault" if alone else answer.verdict,
        sentence=told if alone else f"{told} {answer.sentence}",
        effects=(*answer.effects, *named),
        nothing_probability=0.0,
        gap=gap,
        nominal=given,
        refitted=described(found.given),
    )


def _moves(sensors: Sequence[Sensor], nodes: Sequence[str]) -> Iterator[Moves]:
    """List one sensor at another node, and two sensors at each other's."""
    movable = [
        i for i, one in enumerate(sensors) if one.node in nodes and one.quantity != "force"
    ]
    for i in movable:
        yield from ({i: node} for node in nodes if node != sensors[i].node)
    for i, j in itertools.combinations(movable, 2):
        alike = (sensors[i].quantity, sensors[i].unit) == (sensors[j].quantity, sensors[j].unit)
        if alike and sensors[i].node != sensors[j].node:
            yield {i: sensors[j].node, j: sensors[i].node}


def _moved(description: Description, moves: Moves) -> Description:
    sensors = (
        dataclasses.replace(one, node=moves.get(i, one.node))
        for i, one in enumerate(description.sensors)
    )
    return dataclasses.replace(description, sensors=tuple(sensors))


def _left(
    description: Description, trial: Trial, kinds: Mapping[str, Kind], nodes: Sequence[str]
) -> Float[np.ndarray, "sensor node"]:
    """Mean square that each sensor at each node leaves of its record, relative to it."""
    # A sensor of a force has no node to be moved to.
    every = tuple(
        dataclasses.replace(sensor, channel=f"{i} at {node}", node=node)
        for i, sensor in enumerate(description.sensors)
        for node in nodes
        if sensor.quantity != "force"
    )
    plant = Plant.of(dataclasses.replace(description, sensors=every, effects=()), kinds=kinds)
    told = plant.simulate(plant.values, trial.inputs, trial.rate_hz, start_s=trial.start_s)
    moving = [i for i, one in enumerate(description.sensors) if one.quantity != "force"]
    runs = told.reshape(len(told), len(moving), len(nodes))
    measured = trial.measured[:, moving, None]
    left = np.where(trial.used[:, moving, None], measured - runs, 0.0)
    shares = np.ones((len(description.sensors), len(nodes)))
    shares[moving] = np.mean(left**2, axis=0) / np.mean(measured**2, axis=0).clip(1e-300)
    return shares


def _gained(
    left: Float[np.ndarray, "sensor node"],
    nodes: Sequence[str],
    sensors: Sequence[Sensor],
    moves: Moves,
) -> float:
    """Mean square that an arrangement leaves less than the one of the model."""
    return sum(
        float(left[i][nodes.index(sensors[i].node)] - left[i][nodes.index(node)])
        for i, node in moves.items()
    )


def _named(given: Description, number: int, node: str) -> NamedEffect:
    """Name a sensor that sits at another node."""
    sensor = given.sensors[number]
    at = float([one.id for one in given.nodes].index(node) + 1)
    place = Place("sensor", sensor.channel)
    return NamedEffect(
        effect=Effect(MISPLACED, place, {"node_number": at}),
        family="sensor",
        numbers={"node_number": Number(at, 0.0, "")},
        probability=0.99,
        rivals=(),
        sentence=f"Sensor {sensor.channel} reads the motion of node {node}, not of "
        f"{sensor.node}.",
    )

"""What a tool is given, the linear model in it, and the files that it answers with."""

import argparse
import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.real_rigs.pieces import Array, Piece, read_piece

HEAD = 0.2
"""[share of a record] Whose outputs may be used to find its initial state. Source: what
`slowtime.discrepancy.validation.free_run` uses, so that all know the same."""
TRAINED = 0.7
"""[share of a record] That settings of a tool are tried on before the rest of it chooses among
them. Source: a usual split."""


@dataclasses.dataclass(frozen=True, eq=False)
class Rig:
    """Masses, springs and channels of a model file.

    Parameters
    ----------
    masses
        By node [kg].
    to
        Elongation of each element by displacement of each node [element, node].
    stiffness, damping
        By element.
    push
        Force on each node by input [node, input]; of a base acceleration, minus the masses.
    shaken
        Column of the input that is the acceleration of the base, or None.
    angular
        Whether coordinates are angles.
    """

    masses: Array
    to: Array
    stiffness: Array
    damping: Array
    push: Array
    shaken: int | None
    angular: bool
    inputs: tuple[str, ...]
    sensors: tuple[dict[str, Any], ...]

    @property
    def size(self) -> int:
        """Number of nodes."""
        return len(self.masses)

    @property
    def element_nodes(self) -> list[list[int]]:
        """Nodes at the ends of each element, without the base."""
        return [np.flatnonzero(row).tolist() for row in self.to]

    def rates(self) -> Array:
        """Return the state matrix of displacements and velocities."""
        n = self.size
        k = self.to.T @ np.diag(self.stiffness) @ self.to
        c = self.to.T @ np.diag(self.damping) @ self.to
        inverse = np.diag(1.0 / self.masses)
        return np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ k, -inverse @ c]])

    def node_of(self, sensor: dict[str, Any]) -> int:
        """Return the node of a sensor."""
        return int(sensor["place"])

    def is_shaken(self, sensor: dict[str, Any]) -> bool:
        """Whether the motion of the base is part of what a sensor measures."""
        absolute = sensor.get("frame", "absolute") == "absolute"
        return absolute and self.shaken is not None and sensor["quantity"] == "acceleration"

    def output_rows(self) -> tuple[Array, Array]:
        """Return sensors by state [sensor, state] and by input [sensor, input]."""
        n, rates = self.size, self.rates()
        state, feed = [], []
        for sensor in self.sensors:
            i = self.node_of(sensor)
            row = {"displacement": np.eye(2 * n)[i], "velocity": np.eye(2 * n)[n + i]}
            row["acceleration"] = rates[n + i]
            through = np.zeros(len(self.inputs))
            if sensor["quantity"] == "acceleration":
                through = self.push[i] / self.masses[i]
                if self.is_shaken(sensor):
                    through = through + np.eye(len(self.inputs))[self.shaken]
            state.append(row[sensor["quantity"]])
            feed.append(through)
        return np.array(state), np.array(feed).reshape(len(self.sensors), len(self.inputs))


def read_rig(path: Path) -> Rig:
    """Read a model file of point masses and springs."""
    told = yaml.safe_load(path.read_text(encoding="utf-8"))
    nodes = {node["id"]: i for i, node in enumerate(told["nodes"])}
    masses = np.array([float(node["mass_kg"]) for node in told["nodes"]])
    to = np.zeros((len(told["elements"]), len(nodes)))
    for row, element in enumerate(told["elements"]):
        first, second = element["between"]
        if first in nodes:
            to[row, nodes[first]] -= 1.0
        if second in nodes:
            to[row, nodes[second]] += 1.0
    inputs = told.get("inputs") or []
    push = np.zeros((len(nodes), len(inputs)))
    shaken = None
    for column, entry in enumerate(inputs):
        if entry["kind"] == "force":
            push[nodes[entry["node"]], column] = 1.0
        else:
            push[:, column], shaken = -masses, column
    return Rig(
        masses=masses,
        to=to,
        push=push,
        shaken=shaken,
        stiffness=np.array([float(e["stiffness_n_per_m"]) for e in told["elements"]]),
        damping=np.array([float(e["damping_n_s_per_m"]) for e in told["elements"]]),
        angular=told.get("unit_of_coordinate", "m") == "rad",
        inputs=tuple(entry["channel"] for entry in inputs),
        sensors=tuple(s | {"place": nodes[s["node"]]} for s in told["sensors"]),
    )


@dataclasses.dataclass(frozen=True, eq=False)
class PeerTask:
    """A model, pieces to learn from, pieces held out, and where to answer.

    `imposed` says that motion is imposed and the force foretold; `law` are the terms of the
    known law, for the one tool that is told them.
    """

    rig: Rig
    learn: tuple[Piece, ...]
    judge: tuple[Piece, ...]
    imposed: bool
    law: tuple[str, ...]
    out: Path

    def inputs(self, piece: Piece) -> Array:
        """Return what is known of a piece before it is run [time, channel]."""
        names = [s["channel"] for s in self.rig.sensors] if self.imposed else self.rig.inputs
        return np.array([piece.channels[n] for n in names]).reshape(len(names), len(piece)).T

    def outputs(self, piece: Piece) -> Array:
        """Return what is to be foretold of a piece [time, channel]."""
        return np.column_stack([piece.channels[n] for n in self.output_names])

    @property
    def output_names(self) -> list[str]:
        """Channels that are foretold: the sensors, or the force where motion is imposed."""
        return (
            list(self.rig.inputs) if self.imposed else [s["channel"] for s in self.rig.sensors]
        )


def read_task(arguments: Sequence[str] | None = None) -> PeerTask:
    """Read what is given on the command line as `slowtime diagnose` is given it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--holdout", action="append", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args(arguments)
    facts = json.loads((given.files[0].parent / "facts.json").read_text())
    return PeerTask(
        rig=read_rig(given.files[0]),
        learn=tuple(map(read_piece, given.files[1:])),
        judge=tuple(map(read_piece, given.holdout)),
        imposed=bool(facts["imposed"]),
        law=tuple(facts["law"]),
        out=given.out,
    )


def folds(task: PeerTask, most: int) -> list[tuple[list[Piece], list[Piece]]]:
    """Split what is learnt from, to choose the settings of a tool by.

    Parameters
    ----------
    most
        Samples of a piece that are judged, at most.

    Returns
    -------
    What is learnt from and what is judged, for each split: each record left out once, or the
    last part of the only one.
    """
    if len(task.learn) > 1:
        return [
            ([p for p in task.learn if p is not left], [_first(left, most)])
            for left in task.learn
        ]
    (only,) = task.learn
    cut = int(TRAINED * len(only)) / only.rate_hz
    return [([only.part(0, cut)], [_first(only.part(cut), most)])]


def _first(piece: Piece, most: int) -> Piece:
    return piece.part(0, min(len(piece), most) / piece.rate_hz)


def mean_frequency(values: Array, rate_hz: float) -> float:
    """Return the mean frequency of a series, weighted by its power [Hz]."""
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values)))) ** 2
    lines = np.fft.rfftfreq(len(values), 1.0 / rate_hz)
    least = 1.0 / (len(values) / rate_hz)
    return max(float((lines * power).sum() / max(power.sum(), 1e-300)), least)


def head_of(count: int) -> int:
    """Return how many samples may be used to find an initial state."""
    return max(int(HEAD * count), min(64, count))


def errors(measured: Sequence[Array], runs: Sequence[Array]) -> float:
    """Root mean square error over the standard deviation, mean over channels [1].

    Parameters
    ----------
    measured, runs
        Of each record [time, channel].
    """
    told, run = np.concatenate(list(measured)), np.concatenate(list(runs))
    with np.errstate(all="ignore"):
        left = np.sqrt(np.mean((told - run) ** 2, axis=0)) / np.std(told, axis=0)
    return float(np.mean(left)) if np.isfinite(left).all() else float("inf")


def write_answer(task: PeerTask, runs: Sequence[Array], answer: dict[str, Any]) -> None:
    """Write free runs on what was held out as ``holdout.npz``, and words as ``answer.json``."""
    task.out.mkdir(parents=True, exist_ok=True)
    measured = [task.outputs(piece) for piece in task.judge]
    np.savez(
        task.out / "holdout.npz",
        channels=np.array(task.output_names),
        t=np.concatenate([np.arange(len(p)) / p.rate_hz for p in task.judge]),
        record=np.repeat(np.arange(len(measured)), [len(m) for m in measured]),
        measured=np.concatenate(measured),
        augmented=np.concatenate(list(runs)),
    )
    (task.out / "answer.json").write_text(json.dumps(answer, indent=1) + "\n")

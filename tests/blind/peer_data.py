"""Smoothed states of records, as regression tools need them."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg
import yaml
from numpy.typing import NDArray

from slowtime_services.files import Record, read_record
from slowtime_services.replay import record_of

from .rig import BASE, Element, Rig
from .world import ON_BASE

Array = NDArray[np.float64]
LETTERS = {"displacement": 0, "velocity": 1, "acceleration": 2}


@dataclasses.dataclass(frozen=True, eq=False)
class Claimed:
    """What the model file says."""

    rig: Rig
    inputs: list[dict[str, Any]]
    sensors: list[dict[str, Any]]
    tolerance: tuple[float, float]


@dataclasses.dataclass(frozen=True, eq=False)
class States:
    """Of one record, all relative to the base, smoothed; one row a sample."""

    displacement: Array
    velocity: Array
    acceleration: Array
    force: Array
    """Measured, on each node [N], that of the moving base included."""
    base: Array
    outputs: Array
    rate_hz: float


def read_model(path: Path) -> Claimed:
    """Read a chain or net of springs; `slowtime` is asked for nothing but the bytes."""
    told = yaml.safe_load(path.read_text())
    nodes = [node["id"] for node in told["nodes"]]
    place = {name: i for i, name in enumerate(nodes)} | {ON_BASE: BASE}
    elements = tuple(
        Element(
            e["id"], place[e["between"][0]], place[e["between"][1]],
            e["stiffness_n_per_m"], e["damping_n_s_per_m"],
        )
        for e in told["elements"]
    )  # fmt: skip
    rig = Rig(tuple(node["mass_kg"] for node in told["nodes"]), elements)
    tolerance = told["tolerance"]
    return Claimed(
        rig, told["inputs"], told["sensors"], (tolerance["stiffness"], tolerance["damping"])
    )


def read_states(path: Path, claimed: Claimed) -> States:
    """Read a record, and smooth it into the states of all nodes.

    What is measured is low-passed without delay at 1.7 times the highest frequency. What is not
    is integrated in the frequency domain above a third of the lowest one, and carried to nodes
    without a sensor by the nominal shapes of as many modes as there are sensors.
    """
    record: Record = (
        record_of(path) if path.suffix == ".mcap" else read_record(path, keep=["all"])
    )
    rig, nodes = claimed.rig, claimed.rig.nodes
    force, base = np.zeros((len(record.samples), rig.size)), np.zeros(len(record.samples))
    for entry in claimed.inputs:
        values = record.channel(entry["channel"]).astype(float)
        if entry["kind"] == "force":
            force[:, nodes.index(entry["node"])] += values
        else:
            base += values
    measured: dict[int, dict[int, Array]] = {0: {}, 1: {}, 2: {}}
    for sensor in claimed.sensors:
        values = record.channel(sensor["channel"]).astype(float)
        kind = LETTERS[sensor["quantity"]]
        measured[kind][nodes.index(sensor["node"])] = values - (base if kind == 2 else 0.0)
    frequencies = rig.frequencies_hz()
    band = (float(frequencies[0]) / 3, 1.7 * float(frequencies[-1]))
    found = []
    for wanted in range(3):
        # From the quantity itself where it was measured, else from the acceleration.
        source = wanted if measured[wanted] else 2
        columns = np.column_stack([measured[source][i] for i in sorted(measured[source])])
        smooth = _filtered(columns, record.rate_hz, band, wanted - source, wanted != source)
        found.append(smooth @ _expansion(rig, sorted(measured[source])).T)
    outputs = np.column_stack([record.channel(s["channel"]) for s in claimed.sensors])
    force = force - np.outer(base, rig.masses)
    return States(
        found[0], found[1], found[2], force, base, outputs.astype(float), record.rate_hz
    )


def _filtered(
    values: Array, rate_hz: float, band: tuple[float, float], order: int, high: bool
) -> Array:
    padded = np.concatenate([values[::-1], values, values[::-1]])
    lines = np.fft.rfftfreq(len(padded), 1.0 / rate_hz)
    gain = 1.0 / (1.0 + (lines / band[1]) ** 16)
    if high:
        gain = gain * (lines / band[0]) ** 8 / (1.0 + (lines / band[0]) ** 8)
    s = 2j * np.pi * np.maximum(lines, 1e-9)
    spectrum = np.fft.rfft(padded, axis=0) * (gain * s**order)[:, None]
    back = np.fft.irfft(spectrum, len(padded), axis=0)
    return np.asarray(back[len(values) : 2 * len(values)])


def _expansion(rig: Rig, heard: list[int]) -> Array:
    n = rig.size
    if len(heard) == n:
        return np.eye(n)
    mass = np.diag(rig.masses)
    _, shapes = scipy.linalg.eigh(-mass @ rig.state_matrix()[n:, :n], mass)
    return np.asarray(shapes[:, : len(heard)] @ np.linalg.pinv(shapes[heard, : len(heard)]))


def write_report(
    out: Path, report: dict[str, Any], runs: dict[str, Array], channels: Any
) -> None:
    """Write what the scoring reads."""
    (out / "report.json").write_text(json.dumps(report, indent=1))
    np.savez(out / "holdout.npz", channels=channels, **runs)  # type: ignore[arg-type]

"""An experiment that was proposed, run on the true system: one more record, and its model.

``experiment_request`` in a report, each key optional::

    {"level_factor": 3.0,           # times the strongest record that was learnt from
     "band_hz": [1.0, 40.0],        # as before where not given
     "excitation": "random",        # or multisine, sweep, sine, free_decay (one blow)
     "duration_s": 30.0,
     "start_s": 300.0,              # campaign time; else `start_part` of the campaign
     "add_sensors": [{...}],        # entries as under `sensors` of the model file
     "add_inputs": [{...}],         # forces; on the new record these only, others rest
     "add_mass": {"node": "m1", "mass_kg": 0.5}}   # known, on this record only

The new record is an ``.npz``. Earlier records are copied, with a channel of zeros for an input
that was not there. A mass stands in the record as the number ``added_mass_kg.m1``; the model
keeps the mass without it. Sensors that are added are in the model and in the new record only.
"""

import dataclasses
import json
import math
import shutil
from pathlib import Path
from typing import Any, Self

import numpy as np

from slowtime_services.files import read_record
from slowtime_services.replay import record_of

from .adjudicate import training_plans
from .files import CASES, SEALED, model_text
from .rig import Rig
from .sensing import Sensor
from .world import ON_BASE, Plan, World, from_json, to_json


@dataclasses.dataclass(frozen=True)
class Request:
    """An experiment in the words of a machine."""

    level_factor: float = 1.0
    band_hz: tuple[float, float] | None = None
    excitation: str | None = None
    duration_s: float = 30.0
    start_s: float | None = None
    start_part: float | None = None
    add_sensors: tuple[dict[str, Any], ...] = ()
    add_inputs: tuple[dict[str, Any], ...] = ()
    add_mass: dict[str, Any] | None = None

    @classmethod
    def from_report(cls, plain: dict[str, Any]) -> Self:
        """Read a request; keys that nobody knows are an error."""
        names = {field.name for field in dataclasses.fields(cls)}
        unknown = set(plain) - names
        if unknown:
            raise ValueError(
                f"Unknown in a request: {', '.join(sorted(unknown))}. Allowed: "
                f"{', '.join(sorted(names))}."
            )
        given = {key: value for key, value in plain.items() if value is not None}
        for key in ("band_hz", "add_sensors", "add_inputs"):
            if key in given:
                given[key] = tuple(given[key])
        return cls(**given)


def perform(out: Path, name: str, request: Request, new_name: str) -> Path:
    """Write a new case: the records of `name`, the one that was asked for, and their model."""
    folder, sealed = out / CASES / name, out / SEALED / name
    truth = json.loads((sealed / "truth.json").read_text())
    world, plans = from_json(truth["world"]), training_plans(truth)
    after = _extended(world, request)
    plan = planned(request, plans, world)
    new_folder, new_sealed = out / CASES / new_name, out / SEALED / new_name
    new_folder.mkdir(parents=True)
    new_sealed.mkdir(parents=True)
    listing = json.loads((folder / "case.json").read_text())
    told = dataclasses.replace(
        world, sensors=after.sensors, driven=(*world.driven, *_nodes(request))
    )
    # Whatever the request calls a force: the laboratory's own name is in model and records.
    resting = told.channels()[len(world.driven) :]
    copied = {
        old: _copy(folder / old, new_folder, resting)
        for old in [*listing["records"], listing["holdout"]]
    }
    taken = after.take(plan)
    columns: dict[str, Any] = {
        channel: np.zeros(len(taken.times)) for channel in world.channels()
    }
    columns |= taken.inputs | {
        s.channel: taken.outputs[:, i] for i, s in enumerate(after.sensors)
    }
    if request.add_mass:
        columns[f"added_mass_kg.{request.add_mass['node']}"] = np.array(
            request.add_mass["mass_kg"]
        )
    file = f"{plan.seed % 2**24:06x}.npz"
    np.savez(new_folder / file, **({"t": taken.times} | columns))
    records = [*(copied[old] for old in listing["records"]), file]
    (new_folder / "model.yaml").write_text(model_text(told))
    held = {"model": "model.yaml", "records": records, "holdout": copied[listing["holdout"]]}
    (new_folder / "case.json").write_text(json.dumps(held, indent=1))
    more = {"case": new_name, "follows": name, "equivalents": [], "world": to_json(after)}
    (new_sealed / "truth.json").write_text(
        json.dumps(truth | more | {"predictable": False}, indent=1)
    )
    shutil.copy(sealed / "clean.npz", new_sealed / "clean.npz")
    return new_folder


def _copy(path: Path, folder: Path, resting: tuple[str, ...]) -> str:
    """Copy a record as it is; with zeros in channels that were not there, as ``.npz``."""
    if not resting:
        shutil.copy(path, folder / path.name)
        return path.name
    record = record_of(path) if path.suffix == ".mcap" else read_record(path, keep=["all"])
    columns: dict[str, Any] = {c: record.channel(c) for c in record.channels}
    columns |= {channel: np.zeros(len(record.samples)) for channel in resting}
    clock = record.aux.get("t")
    start = (record.start_ns or 0) * 1e-9 if clock is None else float(clock[0])
    columns["t"] = start + np.arange(len(record.samples)) / record.rate_hz
    np.savez(folder / f"{path.stem}.npz", **columns)
    return f"{path.stem}.npz"


def _nodes(request: Request) -> tuple[str, ...]:
    return tuple(str(entry["node"]) for entry in request.add_inputs)


def _extended(world: World, request: Request) -> World:
    """Give the laboratory as it is during the experiment."""
    sensors, noise = list(world.sensors), list(world.noise)
    for entry in request.add_sensors:
        sensor = Sensor(str(entry["quantity"]), world.rig.nodes.index(str(entry["node"])))
        if sensor not in sensors:
            sensors.append(sensor)
            noise.append(_noise_of(sensor, world))
    rig: Rig = world.rig
    if request.add_mass:
        node = rig.nodes.index(str(request.add_mass["node"]))
        masses = list(rig.masses)
        masses[node] += float(request.add_mass["mass_kg"])
        rig = dataclasses.replace(rig, masses=tuple(masses))
    world = dataclasses.replace(world, rig=rig, sensors=tuple(sensors), noise=tuple(noise))
    nodes = _nodes(request)
    if nodes:
        # Forces of the size of those of inertia that a shaken base had made.
        unit = float(np.mean(rig.masses)) if ON_BASE in world.driven else 1.0
        world = dataclasses.replace(world, driven=nodes, drive=world.drive * unit)
    return world


def _noise_of(sensor: Sensor, world: World) -> float:
    """Noise 30 dB below typical motion, or that of a sensor of the same kind."""
    for other, noise in zip(world.sensors, world.noise, strict=True):
        if other.quantity == sensor.quantity:
            return noise
    size, speed = world.scale
    typical = {"displacement": size, "velocity": speed, "acceleration": speed**2 / size}
    return typical[sensor.quantity] / 3 * 10**-1.5


def planned(request: Request, plans: list[Plan], world: World) -> Plan:
    """Give the record that is asked for, in the terms of the laboratory."""
    strongest = max(plans, key=lambda plan: plan.level)
    start = request.start_s
    if start is None:
        start = world.campaign_s * (request.start_part or 1.0) + (
            0.0 if request.start_part else 10.0
        )
    return dataclasses.replace(
        strongest,
        level=strongest.level * request.level_factor,
        band_hz=request.band_hz or strongest.band_hz,
        excitation=request.excitation or strongest.excitation,
        seconds=math.floor(request.duration_s * world.rate_hz) / world.rate_hz,
        start_s=float(start),
        seed=int(np.random.default_rng([strongest.seed, 7]).integers(2**62)),
        lead_s=0.0,
        kick=0.0,
    )

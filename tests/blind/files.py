"""Files of a hidden case: what a person would have, and what is sealed apart."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slowtime_schemas.raw import RawHeader, encode_raw
from slowtime_schemas.streams import RAW
from slowtime_services.record import RecordingWriter

from .cases import Case
from .rig import BASE, Rig
from .world import ON_BASE, Taken, World

Array = NDArray[np.float64]
CASES, SEALED = "cases", "sealed"
UNITS = {
    "m": {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2", "force": "N"},
    "rad": {
        "displacement": "rad",
        "velocity": "rad/s",
        "acceleration": "rad/s^2",
        "force": "N m",
    },
}


def write_case(case: Case, out: Path) -> Path:
    """Write ``cases/NAME`` and ``sealed/NAME``; give the first."""
    open_folder, sealed = out / CASES / case.name, out / SEALED / case.name
    open_folder.mkdir(parents=True)
    sealed.mkdir(parents=True)
    (open_folder / "model.yaml").write_text(model_text(case.world))
    rng = np.random.default_rng([int(case.name, 16), 9])
    names = [f"{word:06x}" for word in rng.choice(2**24, len(case.taken), replace=False)]
    timed = any(
        "T" in p.law.force or p.law.name == "harmonic_force" for p in case.world.effects
    )
    files = []
    for name, taken in zip(names, case.taken, strict=True):
        kind = str(rng.choice([".npz", ".csv", ".mcap"], p=[0.5, 0.3, 0.2]))
        bare = kind == ".npz" and not timed and rng.random() < 0.2
        files.append(name + kind)
        write_record(open_folder / files[-1], taken, case.world, rng, clock=not bare)
    held = files.pop(case.held)
    listing = {
        "model": "model.yaml",
        "records": [files[i] for i in rng.permutation(len(files))],
    }
    (open_folder / "case.json").write_text(json.dumps(listing | {"holdout": held}, indent=1))
    (sealed / "truth.json").write_text(json.dumps(case.truth | {"holdout": held}, indent=1))
    held_out = case.taken[case.held]
    np.savez(
        sealed / "clean.npz", t=held_out.times, clean=held_out.clean, measured=held_out.outputs,
        noise=held_out.seen.noise, channels=[s.channel for s in case.world.sensors],
    )  # fmt: skip
    return open_folder


def write_record(
    path: Path, taken: Taken, world: World, rng: np.random.Generator, *, clock: bool = True
) -> None:
    """Write one record in the format that the name asks for, its channels in any order."""
    columns = dict(taken.inputs)
    columns |= {s.channel: taken.outputs[:, i] for i, s in enumerate(world.sensors)}
    names = [list(columns)[i] for i in rng.permutation(len(columns))]
    table = np.column_stack([columns[name] for name in names])
    if path.suffix == ".npz":
        arrays: dict[str, Any] = {name: columns[name] for name in names}
        times = {"t": taken.times} if clock else {"rate_hz": np.array(world.rate_hz)}
        np.savez(path, **(times | arrays))
    elif path.suffix == ".csv":
        rows = [",".join(["t", *names])]
        clocked = np.column_stack([taken.times, table]).tolist()
        form = "%.6f" + ",%.9g" * len(names)
        rows += [form % tuple(row) for row in clocked]
        path.write_text("\n".join(rows) + "\n")
    else:
        _write_mcap(path, taken, world, names, table)


def _write_mcap(path: Path, taken: Taken, world: World, names: list[str], table: Array) -> None:
    units = channel_units(world)
    block = round(world.rate_hz)
    with RecordingWriter(path) as writer:
        for number, first in enumerate(range(0, len(table), block)):
            rows = np.ascontiguousarray(table[first : first + block])
            start_ns = round((taken.times[0] + first / world.rate_hz) * 1e9)
            header = RawHeader(
                site="lab", asset="rig", boot="b", sequence=number, t_ns=start_ns,
                rate_hz=world.rate_hz, first_index=first, dtype="<f8", samples=len(rows),
                channels=tuple(names), units=tuple(units[name] for name in names),
            )  # fmt: skip
            writer.write(RAW, "lab", "rig", encode_raw(header, rows.tobytes()), start_ns)


def channel_units(world: World) -> dict[str, str]:
    """Unit of every channel by name."""
    units = UNITS[world.rig.unit]
    inputs = {c: units["acceleration" if c == "ab" else "force"] for c in world.channels()}
    return inputs | {s.channel: units[s.quantity] for s in world.sensors}


def model_text(world: World) -> str:
    """Write the nominal model as a person would."""
    units = channel_units(world)
    lines = ["slowtime_model: 1", "name: rig"]
    if world.nominal.unit != "m":
        lines.append(f"unit_of_coordinate: {world.nominal.unit}")
    lines += [
        "nodes:",
        *_nodes(world.nominal),
        "elements:",
        *_elements(world.nominal),
        "inputs:" if world.recorded else "inputs: []",
    ]
    told = zip(world.driven, world.channels(), strict=True) if world.recorded else ()
    for node, channel in told:
        kind = "kind: base_acceleration" if node == ON_BASE else f"kind: force, node: {node}"
        lines.append(f"  - {{channel: {channel}, {kind}, unit: {units[channel]}}}")
    lines.append("sensors:")
    for s in world.sensors:
        frame = "absolute" if s.quantity == "acceleration" else "relative_to_base"
        lines.append(
            f"  - {{channel: {s.channel}, quantity: {s.quantity}, node: m{s.node + 1}, "
            f"frame: {frame}, unit: {units[s.channel]}}}"
        )
    stiffness, damping = world.tolerance
    lines.append(f"tolerance: {{stiffness: {stiffness}, damping: {damping}, mass: 0.0}}")
    return "\n".join(lines) + "\n"


def _nodes(rig: Rig) -> list[str]:
    return [
        f"  - {{id: {n}, mass_kg: {m}}}" for n, m in zip(rig.nodes, rig.masses, strict=True)
    ]


def _elements(rig: Rig) -> list[str]:
    return [
        f"  - {{id: {e.id}, between: [{'base' if e.first == BASE else rig.nodes[e.first]}, "
        f"{rig.nodes[e.second]}], stiffness_n_per_m: {e.stiffness}, "
        f"damping_n_s_per_m: {e.damping}}}"
        for e in rig.elements
    ]

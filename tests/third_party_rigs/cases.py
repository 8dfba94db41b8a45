"""Draws of rigs, of what their models lack, and of records."""

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.interpolate import CubicSpline

from .laws import EVERY, LAWS, OFF_ONLY, ON_ONLY, RECORD_S, Change
from .rigs import (
    FINE,
    GROUND,
    STILL,
    Excitation,
    Extra,
    Hysteresis,
    Link,
    Rider,
    Structure,
    plain,
    run,
)
from .rivals import Rig, Seen, distance, elongation, told_late

RATE_HZ = 200.0
RAMP_S = 2.0
"""[s] In which a base begins to move."""
NOISE = 0.01
"""Standard deviation of the sensors' noise over that of what they read."""
STIFFNESS_OFF, DAMPING_OFF = 0.015, 0.10
"""Standard deviation of what the model's constants are off by, relative."""


@dataclasses.dataclass(frozen=True)
class Truth:
    """What the model lacks: names that are right, where, and the leading number.

    Parameters
    ----------
    where
        Element, node or channel; of what joins two points, both in a set.
    change
        What it does to the rig, where rivals of it are known.
    """

    kinds: tuple[str, ...]
    where: str | frozenset[str]
    parameter: str
    value: float
    off: bool
    change: Change | None = None


@dataclasses.dataclass(frozen=True)
class Case:
    """A model, records of what it stands for, and what it lacks."""

    seed: int
    label: str
    excitation: str
    model: dict[str, Any]
    records: dict[str, dict[str, np.ndarray]]
    truth: tuple[Truth, ...]
    nats: tuple[float, float, str] | None = None
    """As of `rivals.distance`."""

    def write(self, folder: Path) -> None:
        """Write model, records and truth as a user has them."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "rig.yaml").write_text(yaml.safe_dump(self.model, sort_keys=False))
        for name, channels in self.records.items():
            np.savez(folder / f"{name}.npz", allow_pickle=False, **channels)
        told = [dataclasses.asdict(one) for one in self.truth]
        for one in told:
            where = one["where"]
            one["where"] = where if isinstance(where, str) else sorted(where)
        case: dict[str, Any] = {
            "label": self.label,
            "excitation": self.excitation,
            "truth": told,
        }
        if self.nats is not None:
            nats, nothing, rival = self.nats
            case |= {"nats": nats, "nothing_nats": nothing, "rival": rival}
        (folder / "truth.json").write_text(json.dumps(case))


@dataclasses.dataclass
class Draft:
    """A structure with its model, to which what is missing is added."""

    rng: np.random.Generator
    structure: Structure
    excitation: str
    scale_force: float
    given: Excitation
    motion: dict[str, np.ndarray]
    truth: list[Truth] = dataclasses.field(default_factory=list)
    channel_faults: list[Callable[[dict[str, np.ndarray]], dict[str, np.ndarray]]] = (
        dataclasses.field(default_factory=list)
    )

    @property
    def size(self) -> int:
        """Number of masses."""
        return len(self.structure.masses)

    def amplitude(self, pair: tuple[int, int]) -> tuple[float, float]:
        """Standard deviations of elongation [m] and rate [m/s] between two points."""
        e, v = elongation(pair, self.given, self.motion)
        return float(np.std(e)), float(np.std(v))

    def add(self, name: str, one: Any) -> None:
        """Add a force, memory or a rider to the structure."""
        more: dict[str, Any] = {name: (*getattr(self.structure, name), one)}
        self.structure = dataclasses.replace(self.structure, **more)

    def place(self, pair: tuple[int, int]) -> str | frozenset[str]:
        """Name of the element there, or both ends where there is none."""
        for link in self.structure.links:
            if set(link.between) == set(pair):
                return link.name
        return frozenset(_name(end) for end in pair)


def _name(end: int) -> str:
    return {GROUND: "base", STILL: "still"}.get(end, f"f{end + 1}")


def add_law(draft: Draft, name: str, pair: tuple[int, int], size: float) -> None:
    """Add a law, or a Bouc-Wen spring, between two points."""
    e, v = draft.amplitude(pair)
    force, where = size * draft.scale_force, draft.place(pair)
    off = not isinstance(where, str)
    if name == "bouc_wen":
        one = Hysteresis(pair, force / e, 0.7 * e)
        draft.add("hysteresis", one)
        own = "yielding_link" if off else "bouc_wen"
        kinds = (own, "bouc_wen_general", "friction_in_series_with_spring", "dahl")
        change = Change(name, pair, one.stiffness)
        draft.truth.append(Truth(kinds, where, "kh_n_per_m", one.stiffness, off, change))
        return
    law = EVERY[name]
    value = law.strength(force, e, v)
    draft.add("forces", (pair, law.force(value, e, v, 1.0)))
    change = Change(name, pair, value)
    draft.truth.append(Truth(law.kinds, where, law.parameter, value, off, change))


def heavier(draft: Draft, size: float) -> None:
    """One mass is not what the model says."""
    at = int(draft.rng.integers(draft.size))
    more = float(draft.rng.choice([-1.0, 1.0])) * (0.05 + size) * draft.structure.masses[at]
    masses = list(draft.structure.masses)
    masses[at] += more
    draft.structure = dataclasses.replace(draft.structure, masses=tuple(masses))
    draft.truth.append(
        Truth(("added_mass",), _name(at), "dm_kg", more, True, Change("mass", (at,), more))
    )


def lighter_in_time(draft: Draft, size: float) -> None:
    """One mass falls evenly over each record."""
    at = int(draft.rng.integers(draft.size))
    less = -(0.05 + size) * draft.structure.masses[at]
    along = np.eye(draft.size)[at]
    draft.structure = dataclasses.replace(
        draft.structure, more_mass=lambda t: less * t / RECORD_S * along
    )
    change = Change("lighter in time", (at,), less)
    draft.truth.append(Truth(("mass_drift",), _name(at), "dm_kg", less, True, change))


def lost_mass(draft: Draft, size: float) -> None:
    """A part falls off one mass, or lands on it."""
    at = int(draft.rng.integers(draft.size))
    more = float(draft.rng.choice([-1.0, 1.0])) * (0.05 + size) * draft.structure.masses[at]
    along = np.eye(draft.size)[at]
    draft.structure = dataclasses.replace(
        draft.structure, more_mass=lambda t: more * (t >= 0.4 * RECORD_S) * along
    )
    change = Change("lost mass", (at,), more)
    draft.truth.append(Truth(("mass_jump",), _name(at), "dm_kg", more, True, change))


def neighboured(draft: Draft, size: float) -> None:
    """A law joins a mass to a neighbour that stands still while the base moves."""
    names = [*OFF_ONLY, "cubic", "drag", "stop"]
    name = str(draft.rng.choice(names))
    add_law(draft, name, (STILL, int(draft.rng.integers(draft.size))), size)


def rider(draft: Draft, size: float) -> None:
    """A mass that nobody knows of rides on one of the others."""
    at = int(draft.rng.integers(draft.size))
    mass = (0.03 + size / 4) * draft.structure.masses[at]
    hertz = float(draft.rng.uniform(0.8, 1.3)) * draft.structure.frequencies_hz().min()
    stiffness = mass * (2 * math.pi * hertz) ** 2
    damping = 0.1 * math.sqrt(stiffness * mass)
    draft.add("riders", Rider(at, mass, stiffness, damping))
    change = Change("rider", (at,), mass, hertz)
    draft.truth.append(Truth(("extra_dof",), _name(at), "mass_kg", mass, True, change))


def channel(draft: Draft, size: float, what: str) -> None:
    """A sensor, or the input, does not tell what was there."""
    sensor = what.startswith("sensor")
    at = int(draft.rng.integers(draft.size)) if sensor else 0
    name = f"a{at + 1}" if sensor else "u"
    if what.endswith("delay"):
        value = float(draft.rng.uniform(0.004, 0.02))
        parameter = "delay_s"
    else:
        value, parameter = float(draft.rng.choice([0.8, 1.25])), "gain"

    def fault(told: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        true = told[name]
        wrong = value * true if parameter == "gain" else told_late(true, told["t"], value)
        return told | {name: wrong}

    draft.channel_faults.append(fault)
    # A recorder that tells the input late is an input that acts early.
    turned = {"delay_s": -value, "gain": 1.0 / value}[parameter] if not sensor else value
    late = parameter == "delay_s"
    change = Change(
        what, (at,) if sensor else (), 1.0 if late else turned - 1.0, turned if late else 1.0
    )
    kinds = (what.replace(" ", "_"),)
    draft.truth.append(Truth(kinds, name, parameter, turned, True, change))


def rewired(draft: Draft, size: float) -> None:
    """Two channels are exchanged, or one sensor sits at another mass, or is upside down."""
    i, j = draft.rng.permutation(draft.size)[:2].tolist()
    what = str(draft.rng.choice(["exchanged", "elsewhere", "upside down"]))
    one, other = f"a{i + 1}", f"a{j + 1}"

    def fault(told: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        if what == "exchanged":
            return told | {one: told[other], other: told[one]}
        return told | {one: told[other] if what == "elsewhere" else -told[one]}

    draft.channel_faults.append(fault)
    if what == "upside down":
        change = Change("sensor gain", (i,), -2.0)
        draft.truth.append(Truth(("sensor_gain",), one, "gain", -1.0, True, change))
        return
    places = [(one, i, j), (other, j, i)][: 2 if what == "exchanged" else 1]
    for name, own, at in places:
        kinds, change = ("sensor_misplaced",), Change("elsewhere", (own, at))
        draft.truth.append(Truth(kinds, name, "node_number", float(at + 1), True, change))


def gyroscopic(draft: Draft, size: float) -> None:
    """A spinning disc couples two directions, the first and the second half of the masses."""
    half = draft.size // 2
    at = int(draft.rng.integers(half))
    pair = (at, half + at)
    value = 4.0 * size * draft.scale_force / draft.amplitude((GROUND, half + at))[1]
    value = float(value * draft.rng.choice([-1.0, 1.0]))
    extra = plain(draft.size, draft.size)
    damping = np.zeros((draft.size, draft.size))
    damping[pair], damping[pair[::-1]] = value, -value
    more = dataclasses.replace(extra, damping=damping)
    draft.structure = dataclasses.replace(draft.structure, extra=more)
    kinds, where = ("gyroscopic_coupling",), draft.place(pair)
    change = Change("gyroscopic", pair, value)
    draft.truth.append(Truth(kinds, where, "g_n_s_per_m", value, True, change))


def rocking(draft: Draft, size: float) -> None:
    """The base turns on soft ground, and every mass with it by its height: no name is right."""
    masses = np.array(draft.structure.masses)
    heights = 0.4 * np.arange(1, draft.size + 1)
    along = np.append(np.zeros(draft.size), 1.0)
    reading = np.hstack([np.eye(draft.size), heights[:, None]])
    inertia = 0.2 * float(masses @ heights**2)
    mass = reading.T @ np.diag(masses) @ reading - np.diag([*masses, 0.0])
    mass += inertia * np.outer(along, along)
    hertz = 1.5 * draft.structure.frequencies_hz().min()
    stiffness = float(mass[-1, -1] * (2 * math.pi * hertz) ** 2) * np.outer(along, along)
    extra = Extra(mass, 0.002 * stiffness, stiffness, 1.0 - along, reading)
    draft.structure = dataclasses.replace(draft.structure, extra=extra)
    draft.truth.append(Truth(("rocking",), "base", "", 0.0, off=True))


def beamed(draft: Draft, size: float) -> None:
    """A law joins a node of a frame to the ground, or to another that none joins."""
    names = [*OFF_ONLY, "cubic", "drag", "stop"]
    name = str(draft.rng.choice(names))
    pairs = off_pairs(draft.size)
    add_law(draft, name, pairs[int(draft.rng.integers(len(pairs)))], size)


FURTHER: dict[str, Callable[[Draft, float], None]] = {
    "gyroscopic": gyroscopic, "wiring": rewired, "rocking": rocking, "frame": beamed,
}  # fmt: skip
LATEST: dict[str, Callable[[Draft, float], None]] = {
    "lost mass": lost_mass, "neighbour": neighboured,
}  # fmt: skip


CHANNELS = ("sensor delay", "sensor gain", "input delay", "input gain")


def excite(
    rng: np.random.Generator,
    structure: Structure,
    how: str,
    level: float = 1.0,
    *,
    from_rest: bool = False,
) -> Excitation:
    """Draw an excitation of a record; from rest, a moving base stays about its place."""
    samples = round(RATE_HZ * RECORD_S)
    fine = np.arange((samples - 1) * FINE + 1) / (RATE_HZ * FINE)
    size = len(structure.masses)
    hertz = np.sort(structure.frequencies_hz())
    low, high = 0.4 * hertz[0], min(1.6 * hertz[-1], 0.2 * RATE_HZ)
    loads, ground = np.zeros((len(fine), size)), np.zeros(len(fine))
    start = np.zeros((2, size))

    def noise() -> np.ndarray:
        lines = np.fft.rfftfreq(len(fine), 1 / (RATE_HZ * FINE))
        own = (lines > low) & (lines < high)
        phases = np.exp(2j * np.pi * rng.random(len(lines)))
        series = np.fft.irfft(own * phases, len(fine))
        return np.asarray(series / series.std())

    if how == "random":
        loads[:, -1] = 20.0 * level * noise()
    elif how == "sweep":
        turns = low * fine + (high - low) * fine**2 / (2 * fine[-1])
        loads[:, -1] = 20.0 * level * np.sin(2 * np.pi * turns + rng.uniform(0, 2 * np.pi))
    elif how == "ambient":
        loads[:] = 20.0 * level * np.stack([noise() for _ in range(size)], axis=1)
    elif how == "base":
        ground[:] = 5.0 * level * noise()
        if from_rest:
            lines = 2 * np.pi * np.fft.rfftfreq(len(fine), 1 / (RATE_HZ * FINE))
            moved = np.fft.rfft(ground) / -(np.maximum(lines, lines[1]) ** 2)
            ramp = np.sin(np.pi / 2 * np.minimum(fine / RAMP_S, 1.0)) ** 4
            ground[:] = CubicSpline(fine, ramp * np.fft.irfft(moved, len(fine)))(fine, 2)
    elif how == "release":
        stiffness = structure.matrices()[2][:size, :size]
        start[0] = np.linalg.solve(stiffness, level * rng.normal(0, 60.0, size))
    return Excitation(RATE_HZ, samples, loads, ground, start)


def chain(rng: np.random.Generator, size: int) -> Structure:
    """Masses in a row, the first one on the ground."""
    masses = tuple(rng.uniform(1.5, 4.0, size).tolist())
    base_hz = rng.uniform(2.5, 5.0)
    links = []
    for i in range(size):
        above = sum(masses[i:])
        k = (2 * np.pi * base_hz) ** 2 * above * rng.uniform(0.8, 1.4)
        c = 2 * rng.uniform(0.008, 0.02) * math.sqrt(k * masses[i])
        links.append(Link(f"s{i + 1}", (i - 1, i), float(k), float(c)))
    return Structure(masses, tuple(links))


def two_directions(rng: np.random.Generator, size: int) -> Structure:
    """Masses in a row that move in two directions, which nothing couples."""
    one = chain(rng, size)
    links = list(one.links)
    for link in one.links:
        a, b = (end if end == GROUND else end + size for end in link.between)
        k, c = (
            value * float(rng.uniform(0.8, 1.25)) for value in (link.stiffness, link.damping)
        )
        links.append(Link(f"t{link.name[1:]}", (a, b), k, c))
    return Structure((*one.masses, *one.masses), tuple(links))


BEAM_M = 0.5


def frame(rng: np.random.Generator, size: int) -> Structure:
    """A clamped column of beams in bending, with a mass at each node (Euler and Bernoulli)."""
    masses, per_m = rng.uniform(1.5, 4.0, size), float(rng.uniform(0.5, 1.0))
    hertz = float(rng.uniform(3.0, 6.0))
    length = BEAM_M
    bent = np.array([
        [12, 6 * length, -12, 6 * length],
        [6 * length, 4 * length**2, -6 * length, 2 * length**2],
        [-12, -6 * length, 12, -6 * length],
        [6 * length, 2 * length**2, -6 * length, 4 * length**2],
    ]) / length**3  # fmt: skip
    heavy = per_m * length / 420 * np.array([
        [156, 22 * length, 54, -13 * length],
        [22 * length, 4 * length**2, 13 * length, -3 * length**2],
        [54, 13 * length, 156, -22 * length],
        [-13 * length, -3 * length**2, -22 * length, 4 * length**2],
    ])  # fmt: skip
    mass, parts = np.zeros((2 * size, 2 * size)), []
    for i in range(size):
        own = [i - 1, size + i - 1, i, size + i]
        kept = [k for k in range(4) if i or k > 1]
        at = np.ix_([own[k] for k in kept], [own[k] for k in kept])
        mass[at] += heavy[np.ix_(kept, kept)]
        parts.append(np.zeros((2 * size, 2 * size)))
        parts[-1][at] = bent[np.ix_(kept, kept)]
    stiffness = np.sum(parts, axis=0)
    extra = dataclasses.replace(plain(2 * size, size), mass=mass, stiffness=stiffness)
    first = Structure(tuple(masses.tolist()), (), extra=extra).frequencies_hz().min()
    bending = float((hertz / first) ** 2)
    extra = dataclasses.replace(
        extra, stiffness=bending * stiffness, damping=1e-3 * bending * stiffness,
        parts=tuple(bending * part for part in parts), damping_s=1e-3,
    )  # fmt: skip
    return Structure(tuple(masses.tolist()), (), extra=extra)


def _beams(rng: np.random.Generator, structure: Structure) -> dict[str, Any]:
    """Write the frame as a user would; its bending stiffness is off, as other constants are."""
    assert structure.extra is not None
    size = len(structure.masses)
    # 24 EI / L^3 where two beams meet; 12 EI / L^3 at the tip.
    bending = float(structure.extra.stiffness[size - 1, size - 1]) * BEAM_M**3 / 12
    per_m = float(structure.extra.mass[size - 1, size - 1]) * 420 / 156 / BEAM_M
    return {
        "nodes": [
            {"id": _name(i), "kind": "beam", "mass_kg": float(m)}
            for i, m in enumerate(structure.masses)
        ],
        "elements": [
            {
                "id": f"s{i + 1}", "kind": "beam", "between": [_name(i - 1), _name(i)],
                "length_m": BEAM_M, "mass_kg_per_m": per_m, "damping_s": 1e-3,
                "bending_stiffness_n_m2": bending * (1 + STIFFNESS_OFF * rng.normal()),
            }
            for i in range(size)
        ],
    }  # fmt: skip


def off_pairs(size: int) -> list[tuple[int, int]]:
    """Pairs of points that nothing joins in a chain."""
    pairs = [(GROUND, i) for i in range(1, size)]
    return pairs + [(i, j) for i in range(size) for j in range(i + 2, size)]


def draw(seed: int, what: str, how: str) -> Case:
    """Draw a case.

    Parameters
    ----------
    what
        `on`, `off`, `both`, `nothing`, or one of `FURTHER` and `LATEST`.
    how
        `random`, `sweep`, `release`, `ambient` or `base`.
    """
    rng = np.random.default_rng([seed, 53])
    least = 2 if what in ("off", "both") else 1
    made = {"gyroscopic": two_directions, "frame": frame}.get(what, chain)
    several, from_rest = what in (*FURTHER, *LATEST), what == "neighbour"
    structure = made(rng, int(rng.integers(2, 4)) if several else int(rng.integers(least, 5)))
    size = len(structure.masses)
    plain = excite(rng, structure, how, from_rest=from_rest)
    motion = dict(run(structure, plain))
    force = float(np.std(motion["a"]) * np.mean(structure.masses))
    draft = Draft(rng, structure, how, force, plain, motion)
    labels = [_add_one(draft, kind) for kind in {"both": ("on", "off")}.get(what, (what,))]
    model = _model(rng, structure, how)
    records, seen = {}, []
    for name, level in (("a", 1.0), ("b", 0.7), ("held", 0.9)):
        given = excite(rng, structure, how, level, from_rest=from_rest)
        motion = dict(run(draft.structure, given))
        told = _told(motion, given, how, size)
        for fault in draft.channel_faults:
            told = fault(told)
        clean = np.stack([told[f"a{i + 1}"] for i in range(size)], axis=1)
        seen.append(Seen(given, motion, clean, told.get("u"), NOISE * clean.std(axis=0)))
        for key in told:
            if key.startswith("a") and key != "ag":
                told[key] = told[key] + NOISE * np.std(told[key]) * rng.normal(
                    size=len(told[key])
                )
        records[name] = told
    for sensor in model["sensors"]:
        noise = NOISE * np.std(records["a"][sensor["channel"]])
        sensor["noise_sd"] = float(f"{noise:.4g}")
    label = " and ".join(one for one in labels if one) or "nothing"
    changes = tuple(one.change for one in draft.truth if one.change is not None)
    if not changes:
        return Case(seed, label, how, model, records, tuple(draft.truth))
    tolerance = (model["tolerance"]["stiffness"], model["tolerance"]["damping"])
    rig = Rig(
        draft.structure, changes, draft.amplitude, _off(model, structure), tolerance,
        ambient=how == "ambient",
    )  # fmt: skip
    return Case(seed, label, how, model, records, tuple(draft.truth), distance(rig, seen[:2]))


def _off(model: dict[str, Any], structure: Structure) -> np.ndarray:
    """Tell by how much stiffness, then damping, of each part are off in a model, relative."""
    if not structure.links:
        assert structure.extra is not None
        true = (
            float(structure.extra.stiffness[*[len(structure.masses) - 1] * 2]) * BEAM_M**3 / 12
        )
        given = [part["bending_stiffness_n_m2"] / true - 1 for part in model["elements"]]
        return np.array(given + [0.0] * len(given))
    return np.array([
        part[key] / getattr(link, own) - 1
        for key, own in (("stiffness_n_per_m", "stiffness"), ("damping_n_s_per_m", "damping"))
        for part, link in zip(model["elements"], structure.links, strict=True)
    ])  # fmt: skip


def _add_one(draft: Draft, kind: str) -> str:
    rng, size = draft.rng, float(draft.rng.uniform(0.08, 0.25))
    if kind == "nothing":
        return ""
    if kind in (further := FURTHER | LATEST):
        further[kind](draft, size)
        where = draft.truth[-1].where
        return f"{kind} at {where if isinstance(where, str) else '-'.join(sorted(where))}"
    if kind == "on":
        names = [*LAWS, "bouc_wen", *ON_ONLY]
        name = names[int(rng.integers(len(names)))]
        at = int(rng.integers(draft.size))
        add_law(draft, name, (at - 1, at), size)
        return f"{name} on {draft.truth[-1].where}"
    others: dict[str, Callable[[Draft, float], None]] = {
        "mass": heavier, "rider": rider, "lighter in time": lighter_in_time,
    }  # fmt: skip
    pairs = off_pairs(draft.size)
    # Half of them join points that nothing joins in the model.
    if rng.random() < 0.5 and pairs:
        names = [*LAWS, "bouc_wen", *OFF_ONLY]
        name = names[int(rng.integers(len(names)))]
        add_law(draft, name, pairs[int(rng.integers(len(pairs)))], size)
        return f"{name} between {'-'.join(sorted(draft.truth[-1].where))}"
    names = list(others)
    if draft.excitation in ("random", "sweep"):
        names += CHANNELS
    else:
        names += [one for one in CHANNELS if one.startswith("sensor")]
    name = names[int(rng.integers(len(names)))]
    if name in others:
        others[name](draft, size)
    else:
        channel(draft, size, name)
    return f"{name} at {draft.truth[-1].where}"


def _model(rng: np.random.Generator, structure: Structure, how: str) -> dict[str, Any]:
    size = len(structure.masses)
    inputs: list[dict[str, Any]] = []
    if how in ("random", "sweep"):
        inputs = [{"channel": "u", "kind": "force", "node": _name(size - 1), "unit": "N"}]
    elif how == "base":
        inputs = [{"channel": "ag", "kind": "base_acceleration", "unit": "m/s^2"}]
    parts = (
        _beams(rng, structure)
        if not structure.links
        else {
            "nodes": [
                {"id": _name(i), "mass_kg": float(m)} for i, m in enumerate(structure.masses)
            ],
            "elements": [
                {
                    "id": link.name,
                    "between": [_name(end) for end in link.between],
                    "stiffness_n_per_m": link.stiffness * (1 + STIFFNESS_OFF * rng.normal()),
                    "damping_n_s_per_m": link.damping * (1 + DAMPING_OFF * rng.normal()),
                }
                for link in structure.links
            ],
        }
    )
    return {
        "slowtime_model": 1,
        "name": f"rig of {size}",
        **parts,
        **({"inputs": inputs} if inputs else {}),
        "sensors": [
            {
                "channel": f"a{i + 1}", "quantity": "acceleration", "node": _name(i),
                "unit": "m/s^2",
            }
            for i in range(size)
        ],
        "tolerance": {"stiffness": 0.03, "damping": 0.2, "mass": 0.0},
    }  # fmt: skip


def _told(motion: Any, given: Excitation, how: str, size: int) -> dict[str, np.ndarray]:
    told = {"t": np.arange(given.samples) / given.rate_hz}
    if how in ("random", "sweep"):
        told["u"] = given.loads[::FINE, size - 1]
    elif how == "base":
        told["ag"] = given.ground[::FINE]
    return told | {f"a{i + 1}": motion["a"][:, i] for i in range(size)}

"""Which cases there are: rigs, excitations, sensors, effects, drawn so that all occur."""

import dataclasses

import numpy as np

from .laws import LAWS, LISTED, UNLISTED
from .rig import BASE, Element, Rig
from .sensing import Sensor, Wander, draw_colour
from .world import ON_BASE, Plan, World, whole_samples

GROUPS = ("listed", "nothing", "parameters", "outside", "two")
SHARES = (0.55, 0.22, 0.05, 0.09, 0.09)
MODES = ("states", "accelerations", "partial")
PAIRABLE = tuple(
    name
    for name in LISTED
    if name not in ("pendulum_sine", "base_motion", "sensor_dropout", "added_mass")
)


@dataclasses.dataclass(frozen=True)
class Design:
    """What is asked of one case."""

    group: str
    kinds: tuple[str, ...]
    """Names of the effects, in the order in which they are laid over each other."""
    size: int
    drive: str
    mode: str
    snr_db: int
    stiffness_sd: float
    at_rest: bool
    coloured: bool
    target_db: float
    seconds: tuple[float, float] = (20.0, 60.0)
    """Shortest and longest record."""
    least_db: float = 5.0
    """Effect-to-noise that the case has at least."""
    excitation: str = ""
    """Of all records, where cases differ in that alone; drawn for each where not given."""
    rig_seed: int = 0
    """Of what such cases share."""


def groups_of(count: int, rng: np.random.Generator, only: str | None = None) -> list[str]:
    """Give each case its group, in shuffled order."""
    if only is not None:
        return [only] * count
    edges = np.round(np.cumsum(SHARES) * count).astype(int)
    groups = [GROUPS[int(np.searchsorted(edges, i, side="right"))] for i in range(count)]
    return [groups[i] for i in rng.permutation(count)]


def kinds_of(groups: list[str], rng: np.random.Generator) -> list[tuple[str, ...]]:
    """Give each case its effects: every kind in turn before any comes again."""
    decks = {"listed": LISTED, "outside": UNLISTED}
    left: dict[str, list[str]] = {name: [] for name in decks}
    kinds: list[tuple[str, ...]] = []
    for group in groups:
        if group == "two":
            pair = rng.choice(PAIRABLE, 2, replace=False).tolist()
            while _clash(pair):
                pair = rng.choice(PAIRABLE, 2, replace=False).tolist()
            kinds.append(tuple(pair))
        elif group in decks:
            if not left[group]:
                left[group] = rng.permutation(decks[group]).tolist()
            kinds.append((left[group].pop(),))
        else:
            kinds.append(())
    return kinds


NATURES = {
    "hardening": "stiffness",
    "softening": "stiffness",
    "asymmetric stiffness": "stiffness",
    "linear stiffness": "stiffness",
    "friction": "damping",
    "drag": "damping",
    "linear damping": "damping",
    "negative damping": "damping",
    "time-varying": "time",
    "parametric": "time",
}


def _clash(pair: list[str]) -> bool:
    """Whether two effects are too much alike to be told apart wherever they sit."""
    laws = [LAWS[name] for name in pair]
    natures = {NATURES.get(law.family, law.family) for law in laws}
    return len(natures) == 1 or all(law.where in ("sensor", "input") for law in laws)


def draw_design(group: str, kinds: tuple[str, ...], rng: np.random.Generator) -> Design:
    """Draw what is asked of a case."""
    size = int(rng.choice([1, 3, 2, 5], p=[0.38, 0.42, 0.1, 0.1]))
    drive = str(rng.choice(["force", ON_BASE]))
    mode = str(rng.choice(MODES))
    if "pendulum_sine" in kinds:
        size = min(size, 2)
    if "missing_link" in kinds:
        size = max(size, 2)
    if "base_motion" in kinds:
        drive = "force"
    if mode == "partial" and size < 3:
        mode = str(rng.choice(MODES[:2]))
    snr = int(rng.choice([20, 30, 40]))
    # Noise at 20 dB below the signal leaves little room for an effect above it.
    target = rng.uniform(8, {20: 14, 30: 24, 40: 33}[snr])
    return Design(
        group, kinds, size, drive, mode, snr,
        stiffness_sd=float(rng.choice([0.01, 0.03, 0.05], p=[0.5, 0.25, 0.25])),
        at_rest=bool(rng.random() < 0.5),
        coloured=bool(rng.random() < 0.25),
        target_db=float(target),
    )  # fmt: skip


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def draw_rigs(design: Design, rng: np.random.Generator) -> tuple[Rig, Rig]:
    """Draw the rig as it is claimed to be, and as it is."""
    size = design.size
    first_hz = rng.uniform(*{1: (2.0, 8.0), 2: (2.0, 6.0), 3: (1.8, 4.5), 5: (1.2, 2.5)}[size])
    masses = tuple(_rounded(m) for m in rng.uniform(0.8, 3.0, size))
    shape = rng.uniform(0.7, 1.4, size)
    ends = [(i - 1, i) for i in range(size)]
    if size >= 2 and rng.random() < 0.2 and "missing_link" not in design.kinds:
        ends.append((BASE, size - 1))
        shape = np.append(shape, rng.uniform(0.1, 0.4))
    unit = "rad" if "pendulum_sine" in design.kinds else "m"
    pairs = zip(ends, shape.tolist(), strict=True)
    bare = tuple(Element(f"j{i}", *e, k, 0.0) for i, (e, k) in enumerate(pairs))
    trial = Rig(masses, bare, unit)
    factor = (first_hz / trial.frequencies_hz()[0]) ** 2
    zeta = rng.uniform(0.006, 0.025)
    elements = []
    for element in trial.elements:
        k = element.stiffness * factor
        c = 2 * zeta * k / (2 * np.pi * first_hz * np.sqrt(size)) * rng.uniform(0.7, 1.4)
        elements.append(
            dataclasses.replace(element, stiffness=_rounded(k), damping=_rounded(c))
        )
    nominal = dataclasses.replace(trial, elements=tuple(elements))
    count = len(elements)
    stiffness = _errors(count, design.stiffness_sd, rng)
    damping = _errors(count, 0.10, rng)
    if design.group == "parameters":
        far = rng.uniform(4.0, 8.0, count) * design.stiffness_sd
        stiffness = 1 + (1 if rng.random() < 0.5 else -1) * far
        damping = damping * (1 + rng.uniform(0, 0.6))
    return nominal, nominal.scaled(stiffness.tolist(), damping.tolist())


def _errors(count: int, sd: float, rng: np.random.Generator) -> np.ndarray:
    """Factors with normal errors, no error beyond twice its standard deviation."""
    errors = rng.standard_normal(4 * count + 40)
    return np.asarray(1 + sd * errors[np.abs(errors) < 2][:count])


def draw_sensors(design: Design, rng: np.random.Generator) -> tuple[Sensor, ...]:
    """Draw what is listened to."""
    nodes = list(range(design.size))
    if design.mode == "states":
        return tuple(
            Sensor(q, i) for q in ("displacement", "velocity", "acceleration") for i in nodes
        )
    if design.mode == "partial":
        count = {3: 2, 5: 3}[design.size]
        nodes = sorted(rng.choice(nodes, count, replace=False).tolist())
    return tuple(Sensor("acceleration", i) for i in nodes)


def draw_plans(
    design: Design, rig: Rig, rate_hz: float, rng: np.random.Generator
) -> tuple[list[Plan], int]:
    """Draw the records in the order of the campaign, and which of them is held out."""
    frequencies = rig.frequencies_hz()
    levels = [*rng.permutation([0.5, 1.0, 2.0]).tolist(), float(rng.uniform(0.7, 2.0))]
    same = rng.random() < 0.4
    kinds = rng.choice(["random", "multisine", "sweep"], 4).tolist()
    # The held-out record lies within the campaign, so that nothing is foretold beyond it.
    order = [0, 1, 2]
    held = int(rng.integers(0, 3))
    order.insert(held, 3)
    plans, start = [], 0.0
    for index in order:
        seconds = whole_samples(rng.uniform(*design.seconds), rate_hz)
        band = (
            float(rng.uniform(0.3, 0.6) * frequencies[0]),
            float(rng.uniform(1.15, 1.7) * frequencies[-1]),
        )
        running = not design.at_rest and rng.random() < 0.6
        plans.append(
            Plan(
                kinds[0] if same else kinds[index], band, levels[index], seconds, start,
                seed=int(rng.integers(2**62)),
                lead_s=whole_samples(rng.uniform(2, 6), rate_hz) if running else 0.0,
                kick=0.0 if design.at_rest or running else float(rng.uniform(0.5, 2.0)),
            )
        )  # fmt: skip
        start += whole_samples(seconds + rng.uniform(5, 90), rate_hz)
    return plans, held


def draw_world(design: Design, rng: np.random.Generator) -> tuple[World, list[Plan], int]:
    """Draw the rig, its laboratory and its records, all but the effects."""
    nominal, rig = draw_rigs(design, rng)
    highest = float(rig.frequencies_hz()[-1])
    rates = [r for r in (200.0, 250.0, 256.0, 320.0, 400.0, 500.0, 512.0) if r >= 9 * highest]
    rate_hz = float(rng.choice(rates))
    plans, held = draw_plans(design, rig, rate_hz, rng)
    driven: tuple[str, ...] = (ON_BASE,)
    if design.drive == "force":
        count = 2 if design.size >= 3 and rng.random() < 0.15 else 1
        driven = tuple(sorted(rng.choice(rig.nodes, count, replace=False).tolist()))
    sensors = draw_sensors(design, rng)
    colour = draw_colour(rng) if design.coloured else ()
    world = World(
        rig, nominal, (design.stiffness_sd, 0.10), (), driven, 1.0, rate_hz, sensors,
        noise=(1.0,) * len(sensors), noise_follows=bool(rng.random() < 0.25), colour=colour,
        campaign_s=max(plan.start_s + plan.seconds for plan in plans), scale=(1e-3, 1e-1),
        wander=Wander(
            str(rng.choice(["record", "campaign", "walk"], p=[0.5, 0.3, 0.2])),
            int(rng.integers(2**31)),
        ),
        stuck=bool(rng.random() < 0.5),
    )  # fmt: skip
    return _sized(world, plans, rng), plans, held


def _sized(world: World, plans: list[Plan], rng: np.random.Generator) -> World:
    """Choose the excitation for elongations of a sensible size."""
    middle = dataclasses.replace(next(p for p in plans if p.level == 1.0), lead_s=0.0, kick=0.0)
    elongations, speeds, _ = world.linear_scale(middle)
    size = float(np.sqrt(np.mean(elongations**2)))
    wanted = (
        rng.uniform(0.15, 0.35) if world.rig.unit == "rad" else 10 ** rng.uniform(-3.7, -2.3)
    )
    drive = _rounded(wanted / size)
    speed = float(np.sqrt(np.mean(speeds**2))) * drive
    return dataclasses.replace(world, drive=drive, scale=(size * drive * 3, speed * 3))


def draw_place(kind: str, world: World, rng: np.random.Generator) -> str:
    """Draw where an effect sits."""
    rig, where = world.rig, LAWS[kind].where
    if where == "structure":
        joined = {(e.first, e.second) for e in rig.elements}
        free = [(a, b) for b in range(rig.size) for a in range(BASE, b) if (a, b) not in joined]
        a, b = free[int(rng.integers(len(free)))]
        return f"{ON_BASE if a == BASE else rig.nodes[a]}-{rig.nodes[b]}"
    names = {
        "element": [element.id for element in rig.elements],
        "node": list(rig.nodes),
        "base": [ON_BASE],
        "input": list(world.channels()),
        "sensor": [sensor.channel for sensor in world.sensors],
    }[where]
    return str(rng.choice(names))

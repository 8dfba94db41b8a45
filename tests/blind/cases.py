"""Hidden cases built from designs, with effects at the strength that was asked."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from .design import Design, draw_design, draw_place, draw_world, groups_of, kinds_of
from .drafts import Draft, Surroundings
from .draws import draft
from .law import Placed
from .laws import LAWS, UNPREDICTABLE
from .motion import Diverged
from .unexplained import unexplained
from .world import ON_BASE, Plan, Taken, World, to_json

PILOT_S = 12.0
DESIGNS, TRIES = 8, 12
MOST_DB = 42.0
"""Effect-to-noise that a case has at most."""


@dataclasses.dataclass(frozen=True, eq=False)
class Case:
    """All of one case; what is sealed is `truth` and `Taken.clean`."""

    name: str
    world: World
    plans: list[Plan]
    held: int
    taken: list[Taken]
    truth: dict[str, Any]

    @property
    def training(self) -> list[Taken]:
        return [taken for i, taken in enumerate(self.taken) if i != self.held]


def draw_cases(count: int, seed: int, only: str | None = None) -> list[tuple[str, Design, int]]:
    """Give name, design and seed of each case of a battery."""
    rng = np.random.default_rng([seed, 4])
    groups = groups_of(count, rng, only)
    kinds = kinds_of(groups, rng)
    designs = [draw_design(g, k, rng) for g, k in zip(groups, kinds, strict=True)]
    names = [f"{word:08x}" for word in rng.choice(2**32, count, replace=False)]
    seeds = rng.integers(2**62, size=count).tolist()
    return list(zip(names, designs, seeds, strict=True))


Redraw = Callable[[str, tuple[str, ...], np.random.Generator], Design]
Pilot = Callable[[World], float]


def build(name: str, design: Design, seed: int, redraw: Redraw = draw_design) -> Case:
    """Draw worlds until one carries its effects well, and take its records.

    Where none does, the same effects are asked for otherwise.
    """
    for again in range(DESIGNS):
        for attempt in range(again * TRIES, (again + 1) * TRIES):
            rng = np.random.default_rng([seed, attempt])
            try:
                return _build(name, design, rng)
            except (Diverged, Unfit):
                continue
        other = np.random.default_rng([seed, again, 1])
        design = redraw(design.group, design.kinds, other)
    raise RuntimeError(f"{design.kinds} could not be built by {DESIGNS} designs.")


class Unfit(ValueError):
    """A draw in which an effect cannot be as strong, or as weak, as was asked."""


def _build(name: str, design: Design, rng: np.random.Generator) -> Case:
    world, plans, held = draw_world(design, rng)
    middle = dataclasses.replace(next(p for p in plans if p.level == 1.0), lead_s=0.0, kick=0.0)
    elongations, speeds, outputs = world.linear_scale(middle)
    noise = outputs.std(axis=0) * 10 ** (-design.snr_db / 20)
    world = dataclasses.replace(world, noise=tuple(noise.tolist()))
    placed: list[Placed] = []
    alone: list[float] = []
    for kind in design.kinds:
        place = draw_place(kind, world, rng)
        here = surroundings(world, plans, held, place, elongations, speeds, outputs)
        sketch = draft(kind, rng, here)
        effect, ratio = strong_enough(
            Placed(LAWS[kind], place, {}), sketch, world, design.target_db,
            lambda trial: _pilot(trial, plans),
        )  # fmt: skip
        placed.append(effect)
        alone.append(ratio)
    world = world.with_effects(*placed)
    taken = [world.take(plan) for plan in plans]
    seen = [record.seen for i, record in enumerate(taken) if i != held]
    ratio, factors = unexplained(
        seen, world.nominal, world.rig, world.sensors, world.tolerance, not design.at_rest
    )
    if design.kinds and not design.least_db <= ratio <= MOST_DB:
        raise Unfit(f"{ratio:.0f} dB")
    truth = truth_of(name, design, world, plans, held, ratio, alone, factors.tolist())
    return Case(name, world, plans, held, taken, truth)


def surroundings(
    world: World,
    plans: list[Plan],
    held: int,
    place: str,
    elongations: np.ndarray,
    speeds: np.ndarray,
    outputs: np.ndarray,
) -> Surroundings:
    rig = world.rig
    names = [element.id for element in rig.elements]
    column = names.index(place) if place in names else 0
    element, claimed = rig.elements[column], world.nominal.elements[column]
    node = rig.nodes.index(place) if place in rig.nodes else 0
    channels = [sensor.channel for sensor in world.sensors]
    force = world.drive * (rig.masses[node] if ON_BASE in world.driven else 1.0)
    return Surroundings(
        stiffness=element.stiffness,
        damping=element.damping,
        elongation=float(np.sqrt(np.mean(elongations[:, column] ** 2))),
        speed=float(np.sqrt(np.mean(speeds[:, column] ** 2))),
        mass=rig.masses[node],
        force=force,
        signal=float(outputs[:, channels.index(place) if place in channels else 0].std()),
        frequencies_hz=tuple(rig.frequencies_hz().tolist()),
        rate_hz=world.rate_hz,
        campaign_s=world.campaign_s,
        inside_s=tuple(
            (p.start_s, p.start_s + p.seconds) for i, p in enumerate(plans) if i != held
        ),
        tolerance=world.tolerance,
        off=(
            element.stiffness / claimed.stiffness - 1,
            element.damping / claimed.damping - 1,
        ),
        weighs=not _one_shaken(world),
    )


def _one_shaken(world: World) -> bool:
    """Whether one mass on a shaken base is all: it answers as stiffness over mass tells."""
    return world.rig.size == 1 and ON_BASE in world.driven


def strong_enough(
    bare: Placed, sketch: Draft, world: World, target_db: float, pilot: Pilot
) -> tuple[Placed, float]:
    """Turn the strength until a short pilot stands as far above the noise as was asked."""
    strength, best = 1.0, (math.inf, 1.0, -math.inf)
    strength = min(max(strength, sketch.low), sketch.high)
    roof = sketch.high
    for _ in range(5):
        effect = dataclasses.replace(bare, parameters=sketch.at(strength))
        try:
            ratio = pilot(world.with_effects(effect))
        except Diverged:
            roof = strength / 2
            strength = max(strength / 4, sketch.low)
            continue
        miss = target_db - ratio
        best = min(best, (abs(miss), strength, ratio))
        further = min(max(strength * 10 ** (miss / 20), sketch.low), roof)
        if abs(miss) < 1.5 or math.isclose(further, strength, rel_tol=0.02):
            break
        strength = further
    if not math.isfinite(best[0]) or best[2] < 6:
        raise Unfit(f"{bare.law.name} at {bare.place}: {best[2]:.0f} dB at best")
    return dataclasses.replace(bare, parameters=sketch.at(best[1])), best[2]


def _pilot(world: World, plans: list[Plan]) -> float:
    """Ratio in a short record between the levels, around the time at which things change."""
    seconds = min(PILOT_S, 60.0 / float(world.rig.frequencies_hz()[0]))
    begin = 0.0
    effect = world.effects[0]
    if effect.law.name == "stiffness_jump":
        begin = effect.parameters["t_jump_s"] - seconds / 2
    elif effect.law.name in ("stiffness_drift", "sensor_drift"):
        # The whole growth within the pilot.
        world = dataclasses.replace(world, campaign_s=seconds)
        if "campaign_s" in effect.parameters:
            short = effect.parameters | {"campaign_s": seconds}
            world = world.with_effects(dataclasses.replace(effect, parameters=short))
    plan = dataclasses.replace(
        plans[0],
        excitation="random",
        level=1.4,
        seconds=seconds,
        start_s=begin,
        lead_s=0.0,
        kick=0.0,
    )
    seen = world.take(plan, noiseless=True).seen
    return unexplained([seen], world.nominal, world.rig, world.sensors, world.tolerance, False)[
        0
    ]


def equivalents(design: Design, world: World) -> list[str]:
    """Answers that no data of this rig and these sensors could tell from the truth."""
    kind = design.kinds[0] if len(design.kinds) == 1 else ""
    single = world.rig.size == 1
    same: list[str] = []
    if single and kind in ("stiffness_loss", "viscous_damping"):
        same.append("parameters_only")
    if single and design.group == "parameters":
        same += ["stiffness_loss", "viscous_damping", "nothing_missing"]
    if _one_shaken(world) and kind in ("stiffness_loss", "added_mass"):
        same += [n for n in ("stiffness_loss", "added_mass", "parameters_only") if n != kind]
    if len(world.sensors) == 1 and kind in ("input_gain", "sensor_gain"):
        same += [n for n in ("input_gain", "sensor_gain") if n != kind]
    return sorted(set(same))


def truth_of(
    name: str,
    design: Design,
    world: World,
    plans: list[Plan],
    held: int,
    ratio: float,
    alone: list[float],
    factors: list[float],
) -> dict[str, Any]:
    effects = [
        {
            "effect": p.law.name,
            "family": p.law.family,
            "where": p.where(),
            "parameters": p.parameters,
            "leading": p.law.leading,
            "listed": p.law.listed,
            "kin": list(p.law.kin),
            "pilot_db": db,
        }
        for p, db in zip(world.effects, alone, strict=True)
    ]
    faults = any(p.law.where in ("sensor", "input") for p in world.effects)
    return {
        "case": name,
        "group": design.group,
        "effects": effects,
        "equivalents": equivalents(design, world),
        "effect_to_noise_db": ratio,
        "refit_factors": factors,
        "predictable": not faults and not any(k in UNPREDICTABLE for k in design.kinds),
        "design": dataclasses.asdict(design),
        "world": to_json(world),
        "plans": [dataclasses.asdict(plan) for plan in plans],
        "held": held,
    }

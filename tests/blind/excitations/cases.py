"""A battery in which only the excitation differs: each rig, with its effect, in every way.

The rig, the place of the effect and its shape are drawn once for all excitations. The size of
the excitation is chosen so that the elongation at the effect is alike, and the strength so that
the effect stands above the noise as was asked.
"""

import dataclasses
from typing import Any

import numpy as np

from tests.blind.cases import Case, Unfit, strong_enough, surroundings, truth_of
from tests.blind.design import Design, draw_place, draw_world
from tests.blind.drafts import Draft
from tests.blind.draws import draft
from tests.blind.law import Placed
from tests.blind.laws import LAWS
from tests.blind.motion import Diverged
from tests.blind.running import Drawn
from tests.blind.unexplained import unexplained
from tests.blind.world import Plan, World, whole_samples

from . import imposed

EXCITATIONS = (
    "sweep", "stepped_sine", "multisine", "hammer", "release", "imposed", "random", "ambient"
)  # fmt: skip
"""Ways to excite a rig: two kinds of sine, periods of a multisine, blows, a release from a
static deflection without any input, imposed displacement with measured force, random force, and
random forces on all masses that nobody measures."""
KINDS = (
    "cubic_hardening", "coulomb", "quadratic_damping", "gap_symmetric", "bouc_wen",
    "stiffness_loss", "gap_one_sided",
)  # fmt: skip
LEAST_DB, MOST_DB = 10.0, 42.0
SHARED_S = (25.0, 45.0)
"""[s] Shortest and longest record, where the excitation asks for no other."""
SECONDS = {"release": (8.0, 16.0), "ambient": (60.0, 90.0), "imposed": (10.0, 20.0)}
"""[s] Lengths of records; of the others as of any case."""
PULLED = 4.0
"""[1] Largest deflection before a release, over the root mean square of the random motion."""
TRIES = 40


def draw(count: int, seed: int) -> list[Drawn]:
    """Give name, design and seed of each case; more cases begin with the same ones."""
    drawn: list[Drawn] = []
    turn = 0
    while len(drawn) < count:
        order = np.random.default_rng([seed, 51, turn])
        pairs = [(kind, way) for kind in KINDS for way in EXCITATIONS]
        for number in order.permutation(len(pairs)).tolist():
            kind, way = pairs[number]
            rig_seed = int(
                np.random.default_rng([seed, 52, turn, KINDS.index(kind)]).integers(2**62)
            )
            rng = np.random.default_rng([seed, 53, turn, number])
            design = draw_design(kind, way, rig_seed)
            drawn.append((f"{rng.integers(2**32):08x}", design, int(rng.integers(2**62))))
        turn += 1
    return drawn[:count]


def draw_design(kind: str, way: str, rig_seed: int) -> Design:
    """Draw a design, of which all excitations of a rig share all but the excitation."""
    rng = np.random.default_rng([rig_seed, 1])
    return Design(
        "listed", (kind,), size=int(rng.choice([1, 2, 3], p=[0.4, 0.2, 0.4])), drive="force",
        mode=str(rng.choice(["states", "accelerations"])), snr_db=int(rng.choice([30, 40])),
        stiffness_sd=float(rng.choice([0.01, 0.03])), at_rest=way != "release", coloured=False,
        target_db=float(rng.uniform(14.0, 24.0)), seconds=SECONDS.get(way, SHARED_S),
        least_db=LEAST_DB, excitation=way, rig_seed=rig_seed,
    )  # fmt: skip


def build(name: str, design: Design, seed: int) -> Case:
    """Build one case; where an excitation cannot show the effect so well, with another rig."""
    for attempt in range(TRIES):
        shared = np.random.default_rng([design.rig_seed, 2, attempt // 4])
        own = np.random.default_rng([seed, attempt])
        try:
            world, plans, held, place, sketch = _shared(design, shared)
            if design.excitation == "imposed":
                return imposed.build(name, design, world, place, sketch, own)
            return _excited(name, design, world, (plans, held), (place, sketch), own)
        except (Diverged, Unfit):
            continue
    raise RuntimeError(f"{design.kinds} by {design.excitation} could not be built.")


def _shared(
    design: Design, rng: np.random.Generator
) -> tuple[World, list[Plan], int, str, Draft]:
    """Draw what all excitations share: the rig, its sensors, and the effect at its place."""
    (kind,) = design.kinds
    alike = dataclasses.replace(design, at_rest=True, seconds=SHARED_S)
    world, plans, held = draw_world(alike, rng)
    world = dataclasses.replace(world, noise_follows=False)
    middle = dataclasses.replace(
        next(p for p in plans if p.level == 1.0), excitation="random", lead_s=0.0, kick=0.0
    )
    elongations, speeds, outputs = world.linear_scale(middle)
    place = draw_place(kind, world, rng)
    here = surroundings(world, plans, held, place, elongations, speeds, outputs)
    size = here.elongation
    world = dataclasses.replace(world, scale=(3 * size, 3 * here.speed))
    return world, plans, held, place, draft(kind, rng, here)


def _excited(
    name: str,
    design: Design,
    world: World,
    campaign: tuple[list[Plan], int],
    effect: tuple[str, Draft],
    rng: np.random.Generator,
) -> Case:
    (place, sketch), (kind,), held = effect, design.kinds, campaign[1]
    world, plans = _driven(world, campaign[0], place, design, rng)
    first = next(plan for i, plan in enumerate(plans) if i != held and plan.level == 1.0)
    outputs = world.linear_scale(first)[2]
    noise = outputs.std(axis=0) * 10 ** (-design.snr_db / 20)
    world = dataclasses.replace(world, noise=tuple(noise.tolist()))
    free = not design.at_rest

    def pilot(trial: World) -> float:
        seen = trial.take(first, noiseless=True).seen
        return unexplained(
            [seen], trial.nominal, trial.rig, trial.sensors, trial.tolerance, free
        )[0]

    bare = Placed(LAWS[kind], place, {})
    placed, alone = strong_enough(bare, sketch, world, design.target_db, pilot)
    world = world.with_effects(placed)
    taken = [world.take(plan) for plan in plans]
    seen = [record.seen for i, record in enumerate(taken) if i != held]
    ratio, factors = unexplained(
        seen, world.nominal, world.rig, world.sensors, world.tolerance, free
    )
    if not LEAST_DB <= ratio <= MOST_DB:
        raise Unfit(f"{ratio:.0f} dB")
    truth = truth_of(name, design, world, plans, held, ratio, [alone], factors.tolist())
    truth |= {"predictable": world.recorded or design.excitation == "release"}
    return Case(name, world, plans, held, taken, truth | _more_equivalents(truth, world))


def _driven(
    world: World, plans: list[Plan], place: str, design: Design, rng: np.random.Generator
) -> tuple[World, list[Plan]]:
    """Excite a rig in one way, about as much at the place of the effect as in any other."""
    way = design.excitation
    kind = "random" if way == "ambient" else way
    if way == "ambient":
        world = dataclasses.replace(world, driven=world.rig.nodes)
    world = dataclasses.replace(world, recorded=way not in ("ambient", "release"))
    plans = [
        dataclasses.replace(
            plan, excitation=kind, seconds=_seconds(design, world, rng), lead_s=0.0,
            kick=PULLED / 3 if way == "release" else 0.0, seed=int(rng.integers(2**62)),
        )
        for plan in plans
    ]  # fmt: skip
    column = [element.id for element in world.rig.elements].index(place)
    middle = next(plan for plan in plans if plan.level == 1.0)
    elongation = world.linear_scale(middle)[0][:, column]
    wanted = world.scale[0] / 3
    size = (
        np.abs(elongation).max() / PULLED
        if way == "release"
        else np.sqrt(np.mean(elongation**2))
    )
    factor = float(wanted / size)
    if way == "release":
        return world, [dataclasses.replace(p, kick=p.kick * factor) for p in plans]
    return dataclasses.replace(world, drive=world.drive * factor), plans


def _seconds(design: Design, world: World, rng: np.random.Generator) -> float:
    return whole_samples(float(rng.uniform(*design.seconds)), world.rate_hz)


def _more_equivalents(truth: dict[str, Any], world: World) -> dict[str, Any]:
    """Add what no record without inputs can tell: forces are known up to a factor."""
    same = set(truth["equivalents"])
    if (
        not world.recorded
        and world.rig.size == 1
        and truth["design"]["kinds"] == ("stiffness_loss",)
    ):
        same |= {"added_mass", "parameters_only"}
    return {"equivalents": sorted(same), "excitation": truth["design"]["excitation"]}

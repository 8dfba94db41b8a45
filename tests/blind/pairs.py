"""Pairs that the data cannot tell apart: of each, one is true, and an experiment would decide.

Force laws are brought to where their difference drowns: noise is raised until the rival,
refitted, leaves no more than chance would, while that something is missing stays plain.
"""

import dataclasses
import math
from typing import Any

import numpy as np

from .adjudicate import SHAPES, least_excess
from .cases import Case, Unfit, surroundings, truth_of
from .design import Design, draw_world
from .drafts import Surroundings
from .law import Placed
from .laws import LAWS
from .motion import Diverged
from .sensing import Sensor
from .unexplained import price, unexplained
from .world import Plan, World

EXCESS = 3.0
"""Chi-squared by which the refitted rival is worse."""
VEILS = 3
"""How often noise is raised at most: as it grows, constants move in the rival's stead."""
LOUDER = 1.2
"""Times the noise that would do, did nothing move as it grows."""
SETTLED = 80.0
"""Periods after which a tone has become steady, so that it shows one amplitude only."""
FAR_S = 20_000.0
"""Between the two ends of a campaign, of which nobody saw the middle."""
QUIET_DB = 3.0
"""Of the signal above the noise, at least."""
PLAIN, PRICE = 80.0, 25.0
"""Chi-squared by which the linear model is worse, at least, within two tolerances of each
constant; and however far they move, what that costs counted in."""


@dataclasses.dataclass(frozen=True)
class Pair:
    """One kind of pair.

    Parameters
    ----------
    sizes
        Parameters of the truth, in units of the motion at its place (`adjudicate.SHAPES`).
    places
        Of truth and rival, where these differ.
    tone
        Whether the excitation is one tone at the first frequency, at one level; else random, in
        a band up to 1.5 times the highest frequency.
    deciding
        An experiment that decides.
    """

    truth: str
    rival: str
    deciding: dict[str, Any]
    sizes: dict[str, float] = dataclasses.field(default_factory=dict)
    size: int = 1
    drive: str = "force"
    mode: str = "accelerations"
    tone: bool = False
    places: tuple[str, str] = ("", "")
    level: float = 1.0
    """Factor on the excitation."""

    @property
    def name(self) -> str:
        ends = [
            f"{n}@{p}" if p else n
            for n, p in zip((self.truth, self.rival), self.places, strict=True)
        ]
        return "|".join(ends)


def _both(
    one: str,
    other: str,
    sizes: tuple[dict[str, float], ...],
    deciding: dict[str, Any],
    deciding_other: dict[str, Any] | None = None,
    **more: Any,
) -> list[Pair]:
    return [
        Pair(one, other, deciding, sizes=sizes[0], **more),
        Pair(other, one, deciding_other or deciding, sizes=sizes[1], **more),
    ]


# A softening spring gives way where a pendulum or a saturating spring only softens.
_CAREFUL = {"level_factor": 2.5, "duration_s": 60.0}
_LOUDER, _LOUD = {"level_factor": 6.0}, {"level_factor": 4.0}
_FAINTER = {"level_factor": 0.15, "duration_s": 60.0}
_TONE: dict[str, Any] = {"tone": True}
_FORCE = {"add_inputs": [{"channel": "f1", "kind": "force", "node": "m1", "unit": "N"}]}


def _added(channel: str, quantity: str, frame: str, unit: str) -> dict[str, str]:
    node = f"m{channel[1:]}"
    return {
        "channel": channel, "quantity": quantity, "node": node, "frame": frame, "unit": unit
    }  # fmt: skip


_SENSOR = {"add_sensors": [_added("x1", "displacement", "relative_to_base", "m")]}
_ELSEWHERE = {
    "add_sensors": [_added(f"a{i}", "acceleration", "absolute", "m/s^2") for i in (1, 2)],
    "excitation": "random",
    "duration_s": 40.0,
}

# Not among them, though one tone at one level seems to make them so: dry friction and either
# damping, softening and a softer spring, a stop and a quadratic spring. Their third or second
# harmonics tell them apart until the noise is so loud that constants explain all.
PAIRS = (
    *_both("stiffness_loss", "added_mass", ({"dk_n_per_m": 0.2}, {"dm_kg": 0.2}), drive="base",
           deciding=_FORCE),
    *_both("input_gain", "sensor_gain", ({"gain": 1.2}, {"gain": 1.2}), deciding=_SENSOR),
    *_both("pendulum_sine", "cubic_softening", ({"k": 1.0}, {"k3_n_per_m3": 1 / 6}), level=0.5,
           mode="states", deciding=_LOUDER, deciding_other=_CAREFUL),
    *_both("saturating_stiffness", "cubic_softening",
           ({"ks_n_per_m": 0.5, "es_m": 6.0}, {"k3_n_per_m3": 0.004}), mode="states",
           deciding=_LOUDER, deciding_other=_CAREFUL),
    *_both("quadratic_damping", "viscous_damping",
           ({"c2_n_s2_per_m2": 0.5}, {"dc_n_s_per_m": 0.8}), deciding=_LOUD, **_TONE),
    Pair("stribeck", "coulomb", _FAINTER, mode="states",
         sizes={"friction_n": 0.05, "static_n": 0.06, "vs_m_per_s": 0.004}),
    *_both("extra_dof", "added_mass", ({"mass_kg": 0.15}, {"dm_kg": 0.15}),
           deciding={"band_hz": [0.5, 60.0], "level_factor": 2.0, "excitation": "random"}),
    *_both("van_der_pol", "viscous_damping",
           ({"cn_n_s_per_m": 0.5, "e0_m": 15.0}, {"dc_n_s_per_m": -0.5}), mode="states",
           deciding={"level_factor": 10.0}),
    *_both("stiffness_jump", "stiffness_drift", ({"dk_n_per_m": 0.05}, {"dk_n_per_m": 0.05}),
           deciding={"start_part": 0.25}),
    Pair("harmonic_force", "harmonic_force", _ELSEWHERE, sizes={"amplitude_n": 1.0}, size=2,
         places=("m1", "m2"), mode="one"),
    Pair("stiffness_loss", "stiffness_loss", _ELSEWHERE, sizes={"dk_n_per_m": 0.15}, size=2,
         places=("j0", "j1"), mode="one", tone=True),
    Pair("viscous_damping", "viscous_damping", _ELSEWHERE, sizes={"dc_n_s_per_m": 2.0}, size=2,
         places=("j1", "j0"), mode="one", tone=True),
)  # fmt: skip


def build_pair(pair: Pair, name: str, seed: int) -> Case:
    """Draw worlds until one carries the pair."""
    for attempt in range(12):
        try:
            return _build(pair, name, np.random.default_rng([seed, attempt]))
        except (Diverged, Unfit):
            continue
    raise RuntimeError(f"{pair.name} could not be built.")


def _build(pair: Pair, name: str, rng: np.random.Generator) -> Case:
    rad = "pendulum_sine" in (pair.truth, pair.rival)
    design = Design(
        "pair", ("pendulum_sine",) if rad else (), pair.size, pair.drive,
        "accelerations" if pair.mode == "one" else pair.mode, 30, 0.01,
        at_rest=not pair.tone, coloured=False, target_db=20.0,
    )  # fmt: skip
    world, plans, held = draw_world(design, rng)
    if pair.mode == "one":
        world = dataclasses.replace(world, sensors=(Sensor("acceleration", 1),), noise=(1.0,))
    plans, held = _plans(pair, world, plans)
    world = dataclasses.replace(
        world, campaign_s=max(p.start_s + p.seconds for p in plans), noise_follows=False,
    )  # fmt: skip
    elongations, speeds, outputs = world.linear_scale(
        dataclasses.replace(plans[0], level=pair.level)
    )
    world = dataclasses.replace(world, noise=tuple((outputs.std(axis=0) * 10**-1.5).tolist()))
    element = world.rig.elements[0].id
    place = (
        pair.places[0]
        or {"element": element, "node": "m1", "input": "f1", "sensor": "a1"}[
            LAWS[pair.truth].where
        ]
    )
    here = surroundings(world, plans, held, place, elongations, speeds, outputs)
    effect = Placed(LAWS[pair.truth], place, _parameters(pair, here, world, plans))
    world = _veiled(
        pair, world.with_effects(effect), [p for i, p in enumerate(plans) if i != held]
    )
    taken = [world.take(plan) for plan in plans]
    seen = [t.seen for i, t in enumerate(taken) if i != held]
    ratio, factors = unexplained(
        seen, world.nominal, world.rig, world.sensors, world.tolerance, pair.tone
    )
    truth = truth_of(name, design, world, plans, held, ratio, [ratio], factors.tolist())
    truth["equivalents"] = [pair.rival]
    truth["pair"] = {
        "name": pair.name,
        "rival": pair.rival,
        "places": pair.places,
        "deciding": pair.deciding,
    }
    return Case(name, world, plans, held, taken, truth)


def _plans(pair: Pair, world: World, plans: list[Plan]) -> tuple[list[Plan], int]:
    first, last = (float(f) for f in world.rig.frequencies_hz()[[0, -1]])
    timed = pair.truth in ("stiffness_jump", "stiffness_drift")
    shaped, start = [], 0.0
    # The held-out record lies between; slow changes are seen at the two ends only.
    for number, level in enumerate((1.0, 1.0, 1.0) if pair.tone or timed else (1.0, 0.8, 0.5)):
        band = (0.97 * first, 1.03 * first) if pair.tone else (0.4 * first, 1.5 * last)
        shaped.append(
            dataclasses.replace(
                plans[number], excitation="sine" if pair.tone else "random", band_hz=band,
                level=level * pair.level, seconds=20.0, start_s=start, kick=0.0,
                lead_s=math.ceil(SETTLED / first) if pair.tone else 0.0,
            )
        )  # fmt: skip
        start += 20.0 + (FAR_S if timed and number else 10.0)
    return shaped, 1


def _parameters(
    pair: Pair, here: Surroundings, world: World, plans: list[Plan]
) -> dict[str, float]:
    size, speed = here.elongation, here.speed
    units = {
        "k": here.stiffness, "c": here.damping, "e": size, "v": speed, "1": 1.0,
        "ke": here.stiffness * size, "k/e": here.stiffness / size,
        "k/e2": here.stiffness / size**2, "c/v": here.damping / speed,
    }  # fmt: skip
    shape = dict(SHAPES.get(pair.truth, ()))
    p = {}
    for name, value in pair.sizes.items():
        unit = shape.get(name, "1")
        sign = -1.0 if unit.startswith("-") else 1.0
        bare = unit.removeprefix("+-").removeprefix("-")
        if pair.truth == "cubic_softening" and "pendulum_sine" == pair.rival:
            bare = "k"
        p[name] = sign * value * units[bare]
    if pair.truth in ("stiffness_jump", "stiffness_drift"):
        p["dk_n_per_m"] *= here.stiffness
        end = plans[-1].start_s
        p |= (
            {"t_jump_s": 0.5 * end}
            if pair.truth == "stiffness_jump"
            else {"campaign_s": world.campaign_s}
        )
    if pair.truth in ("added_mass", "extra_dof"):
        p = {key: value * here.mass for key, value in p.items()}
    if pair.truth == "extra_dof":
        p |= {
            "frequency_hz": 50.0,
            "damping_n_s_per_m": 2 * 0.02 * p["mass_kg"] * 2 * np.pi * 50.0,
        }
    if pair.truth == "harmonic_force":
        p["amplitude_n"] *= 0.3 * here.force
        p |= {"frequency_hz": 1.2 * here.frequencies_hz[0], "phase_rad": 0.4}
    return {key: float(value) for key, value in p.items()}


def _veiled(pair: Pair, world: World, plans: list[Plan]) -> World:
    """Raise the noise until the rival cannot be told; refuse where the effect is lost in it."""
    if pair.truth in SHAPES and pair.rival in SHAPES and pair.places[0] == "":
        for _ in range(VEILS):
            excess = least_excess(world, plans, pair.rival, evaluations=12, enough=EXCESS)
            if excess <= EXCESS:
                break
            factor = LOUDER * math.sqrt(excess / EXCESS)
            world = dataclasses.replace(world, noise=tuple(factor * n for n in world.noise))
        else:
            # Tolerances tell it from the rival, and those no noise drowns.
            raise Unfit(f"{pair.name}: told apart however loud the noise")
    taken = [world.take(plan, noiseless=True) for plan in plans]
    known = world.nominal, world.rig, world.sensors, world.tolerance, pair.tone
    seen = [t.seen for t in taken]
    ratio, _ = unexplained(seen, *known)
    signal = np.concatenate([t.clean for t in taken]).std(axis=0)
    if 20 * np.log10(np.mean(signal / world.noise)) < QUIET_DB:
        raise Unfit(f"{pair.name}: the records are lost in the noise")
    samples = sum(t.outputs.size for t in taken)
    if 10 ** (ratio / 10) * samples < PLAIN:
        raise Unfit(f"{pair.name}: the effect is lost in the noise ({ratio:.0f} dB)")
    if (chi2 := price(seen, *known)) < PRICE:
        raise Unfit(f"{pair.name}: constants explain it within what is claimed ({chi2:.0f})")
    return world

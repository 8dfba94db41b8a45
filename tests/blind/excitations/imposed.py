"""Imposed displacement: one element in a testing machine, which measures motion and force."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import odeint

from tests.blind.cases import Case, Unfit, strong_enough, truth_of
from tests.blind.design import Design
from tests.blind.drafts import Draft
from tests.blind.equations import filled
from tests.blind.law import Placed
from tests.blind.laws import LAWS
from tests.blind.outside.operators import OPERATORS
from tests.blind.rig import BASE, Element, Rig
from tests.blind.sensing import Sensor
from tests.blind.signals import Signal, excitation, knot_rate
from tests.blind.unexplained import Seen
from tests.blind.world import Plan, Taken, World

Array = NDArray[np.float64]
RATE_HZ = 200.0
BAND_HZ = (0.3, 4.0)
"""Of the motion: far below the frequency at which the inertia of a clamp would matter."""
INERTIA = 1e-3
"""[1] Of the force of inertia to that of the spring, at the upper end of the band."""
MOTION_SNR_DB = 70.0
"""Of the displacement: a testing machine knows it far better than the force."""


def build(
    name: str,
    design: Design,
    world: World,
    place: str,
    sketch: Draft,
    rng: np.random.Generator,
) -> Case:
    """Take the element out of its rig, with its effect, and move it through the records."""
    bench = _bench(world, place, design)
    plans = _plans(design, rng)
    held = int(rng.integers(0, len(plans)))
    first = next(plan for i, plan in enumerate(plans) if i != held)
    (kind,) = design.kinds
    bare = Placed(LAWS[kind], "j0", {})

    def pilot(trial: World) -> float:
        return _ratio(trial, [first], design.snr_db)

    placed, alone = strong_enough(bare, sketch, bench, design.target_db, pilot)
    bench = bench.with_effects(placed)
    learnt = [plan for i, plan in enumerate(plans) if i != held]
    ratio = _ratio(bench, learnt, design.snr_db)
    if not 10.0 <= ratio <= 42.0:
        raise Unfit(f"{ratio:.0f} dB")
    taken = [_take(bench, plan, design.snr_db) for plan in plans]
    design = dataclasses.replace(design, size=1, mode="states")
    truth = truth_of(name, design, bench, plans, held, ratio, [alone], [])
    same = ["parameters_only"] if kind == "stiffness_loss" else []
    truth |= {"predictable": False, "excitation": "imposed", "equivalents": same}
    return Case(name, bench, plans, held, taken, truth)


def _bench(world: World, place: str, design: Design) -> World:
    """Give the element of a rig on a bench: as it is, and as it is claimed to be."""

    def alone(rig: Rig) -> Rig:
        element = rig.element(place)
        mass = INERTIA * element.stiffness / (2 * math.pi * BAND_HZ[1]) ** 2
        bench = Element("j0", BASE, 0, element.stiffness, element.damping)
        return Rig((float(f"{mass:.3g}"),), (bench,))

    true, claimed = alone(world.rig), alone(world.nominal)
    sensors = (Sensor("displacement", 0),)
    size = world.scale[0] / 3
    return dataclasses.replace(
        world, rig=dataclasses.replace(true, masses=claimed.masses), nominal=claimed,
        driven=("m1",), sensors=sensors, noise=(size * 10 ** (-MOTION_SNR_DB / 20),),
        rate_hz=RATE_HZ, drive=size, noise_follows=False,
    )  # fmt: skip


def _plans(design: Design, rng: np.random.Generator) -> list[Plan]:
    plans, start = [], 0.0
    for level in [*rng.permutation([0.5, 1.0, 2.0]).tolist(), 1.4]:
        seconds = math.floor(float(rng.uniform(*design.seconds)) * RATE_HZ) / RATE_HZ
        way = str(rng.choice(["random", "multisine", "sweep", "sine"]))
        plans.append(Plan(way, BAND_HZ, level, seconds, start, int(rng.integers(2**62))))
        start += seconds + 10.0
    return plans


def _motion(world: World, plan: Plan, rng: np.random.Generator) -> tuple[Array, Signal]:
    knots = knot_rate(world.rate_hz, plan.band_hz[1])
    values = excitation(plan.excitation, plan.band_hz, plan.seconds + 1.0, knots, rng)
    samples = round(plan.seconds * world.rate_hz)
    return np.arange(samples) / world.rate_hz, Signal.through(
        world.drive * plan.level * values, knots
    )


def _derivatives(signal: Signal, times: Array) -> tuple[Array, Array, Array]:
    """Displacement, velocity and acceleration of a piecewise cubic."""
    place = times * signal.rate_hz
    knot = np.clip(place.astype(int), 0, len(signal.coefficients) - 1)
    s, rate = place - knot, signal.rate_hz
    c3, c2, c1, c0 = signal.coefficients[knot].T
    return (
        ((c3 * s + c2) * s + c1) * s + c0,
        ((3 * c3 * s + 2 * c2) * s + c1) * rate,
        (6 * c3 * s + 2 * c2) * rate**2,
    )


def law_force(placed: Placed, signal: Signal, times: Array) -> Array:
    """Force of a law along an imposed elongation [N].

    Parameters
    ----------
    placed
        A law of an element, or friction, which has no need to stick: its motion is imposed.
    signal
        Elongation [m].
    times
        Where the force is wanted [s].
    """
    e, v, _ = _derivatives(signal, times)
    law, space = placed.law, {"abs": abs, **OPERATORS}
    space |= {n: getattr(math, n) for n in ("tanh", "exp", "cos", "sin", "sqrt", "copysign")}
    inner = np.zeros((len(times), len(law.rates)))
    if law.rates:
        texts = [
            compile(filled(text, placed.parameters), "<rate>", "eval") for text in law.rates
        ]

        def rates(state: Array, t: float) -> list[float]:
            here = [float(x[0]) for x in _derivatives(signal, np.array([t]))[:2]]
            known = {"e": here[0], "v": here[1]} | {f"h{i}": x for i, x in enumerate(state)}
            return [eval(text, space, known) for text in texts]

        size = float(np.abs(e).max())
        inner = odeint(
            rates,
            np.zeros(len(texts)),
            times,
            rtol=1e-7,
            atol=1e-8 * size,
            mxstep=5000,
            hmax=float(np.diff(times).max()),
        )
    text = law.force or f"(1.0 if v > 0 else -1.0)*({law.grip})"
    code = compile(filled(text, placed.parameters), "<force>", "eval")
    rows = zip(e.tolist(), v.tolist(), inner.tolist(), strict=True)
    return np.array(
        [
            eval(
                code,
                space,
                {"e": e, "v": v, "w": abs(v), "d": 1.0 if v > 0 else -1.0}
                | {f"h{i}": x for i, x in enumerate(h)},
            )
            for e, v, h in rows
        ]
    )


def _clean(world: World, plan: Plan) -> tuple[Array, Array, Array, Array, Array]:
    """Times, elongation, its rate, force of the law, and force in all."""
    times, signal = _motion(world, plan, np.random.default_rng(plan.seed))
    e, v, a = _derivatives(signal, times)
    (element,), (mass,) = world.rig.elements, world.rig.masses
    extra = law_force(world.effects[0], signal, times) if world.effects else np.zeros_like(e)
    return times, e, v, extra, element.stiffness * e + element.damping * v + mass * a + extra


def _force_noise(world: World, snr_db: int) -> float:
    """Standard deviation of the force's noise [N]: of its scale at level 1."""
    return world.rig.elements[0].stiffness * world.drive * 10 ** (-snr_db / 20)


def _take(world: World, plan: Plan, snr_db: int) -> Taken:
    times, e, _, _, force = _clean(world, plan)
    rng = np.random.default_rng([plan.seed, 1])
    noise = np.array(world.noise)
    told = force + _force_noise(world, snr_db) * rng.standard_normal(len(force))
    outputs = (e + noise[0] * rng.standard_normal(len(e)))[:, None]
    seen = Seen({}, None, 0, 1, e[:, None], noise)
    return Taken(plan.start_s + times, {"f1": told}, outputs, e[:, None], seen)


def _ratio(world: World, plans: list[Plan], snr_db: int) -> float:
    """What a spring and a damper within their tolerances leave of the force, over its noise."""
    claimed, true = world.nominal.elements[0], world.rig.elements[0]
    columns, extras = [], []
    for plan in plans:
        _, e, v, extra, _ = _clean(world, plan)
        gap = (true.stiffness - claimed.stiffness) * e + (true.damping - claimed.damping) * v
        columns.append(np.stack([e, v], axis=1))
        extras.append(extra + gap)
    matrix, force = np.concatenate(columns), np.concatenate(extras)
    bound = 2.0 * np.array(world.tolerance) * [claimed.stiffness, claimed.damping]
    best, *_ = np.linalg.lstsq(matrix, force, rcond=None)
    left = force - matrix @ np.clip(best, -bound, bound)
    return float(20 * np.log10(max(left.std() / _force_noise(world, snr_db), 1e-6)))

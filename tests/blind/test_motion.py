"""The integrators of the blind cases against closed forms, each other and themselves."""

import dataclasses

import numpy as np
import pytest
from scipy.special import ellipk

from tests.blind.drafts import Surroundings
from tests.blind.draws import DRAWERS, draft
from tests.blind.equations import System
from tests.blind.law import Placed
from tests.blind.laws import LAWS
from tests.blind.linear import linear_motion
from tests.blind.motion import Diverged, move
from tests.blind.rig import Element, Rig
from tests.blind.signals import Signal, excitation, knot_rate

RATE_HZ = 200.0
RIG = Rig(
    (1.9, 2.1),
    (Element("j0", -1, 0, 4100.0, 2.3), Element("j1", 0, 1, 3900.0, 2.2)),
)
SIZES = (3e-3, 0.1)
KNOTS_HZ = knot_rate(RATE_HZ, 12.0)
PUSH = Signal.through(
    1.3 * excitation("random", (1.0, 12.0), 6.0, KNOTS_HZ, np.random.default_rng(3)), KNOTS_HZ
)
TIMES = np.arange(800) / RATE_HZ
HERE = Surroundings(
    3900.0,
    2.2,
    1e-3,
    0.03,
    2.1,
    3.0,
    1.0,
    (4.5, 11.0),
    RATE_HZ,
    4.0,
    ((0.0, 1.0),),
    (0.01, 0.1),
)


def system(*effects, base=()):
    return System(RIG, effects, {1: PUSH}, base)


def of_kind(name):
    law = LAWS[name]
    place = {"element": "j1", "node": "m2"}[law.where]
    return Placed(law, place, draft(name, np.random.default_rng(5), HERE).at(1.0))


def test_the_linear_rig_moves_as_its_closed_form_says():
    base = Signal.through(
        excitation("sweep", (1.0, 9.0), 6.0, KNOTS_HZ, np.random.default_rng(4)), KNOTS_HZ
    )
    start = [1e-3, -2e-3, 0.05, 0.02]
    moved = move(system(base=(base,)), TIMES, start, scale=SIZES)
    stride = round(KNOTS_HZ / RATE_HZ)
    exact = linear_motion(RIG, {1: PUSH}, base, stride * len(TIMES), np.array(start))
    for ours, closed in zip(
        (moved.displacement, moved.velocity, moved.acceleration), exact, strict=True
    ):
        np.testing.assert_allclose(ours, closed[::stride], rtol=0, atol=3e-6 * closed.std())


@pytest.mark.parametrize(
    "name",
    [
        name
        for name in DRAWERS
        if (LAWS[name].force or LAWS[name].grip or LAWS[name].where == "node")
        and name != "pendulum_sine"  # at these small angles it hardly is there; see below
    ],
)
def test_ten_times_finer_tolerance_moves_nothing(name):
    effect = of_kind(name)
    times = TIMES[:400]
    coarse = move(system(effect), times, scale=SIZES)
    fine = move(system(effect), times, scale=SIZES, tolerance=1e-9)
    without = move(system(), times, scale=SIZES).displacement
    error = np.abs(coarse.displacement - fine.displacement).max()
    assert error < 1e-4 * fine.displacement.std()
    assert np.abs(fine.displacement - without).max() > 30 * error


def test_both_integrators_agree_where_friction_holds_nothing():
    slack = Placed(LAWS["coulomb"], "j1", {"friction_n": 0.0})
    bent = of_kind("cubic_hardening")
    by_events = move(system(bent, slack), TIMES, scale=SIZES)
    smoothly = move(system(bent), TIMES, scale=SIZES)
    scale = smoothly.acceleration.std()
    np.testing.assert_allclose(
        by_events.acceleration, smoothly.acceleration, rtol=0, atol=1e-5 * scale
    )


def test_dry_friction_takes_the_same_from_every_half_swing_and_then_holds():
    mass, stiffness, friction = 2.0, 800.0, 1.0
    rig = Rig((mass,), (Element("j0", -1, 0, stiffness, 0.0),))
    nothing = Signal.through(np.zeros(4000), 400.0)
    sliding = System(
        rig, (Placed(LAWS["coulomb"], "j0", {"friction_n": friction}),), {0: nothing}, ()
    )
    half = np.pi / np.sqrt(stiffness / mass)
    turns = half * np.arange(12)
    first = 10.3 * friction / stiffness
    moved = move(sliding, turns, [first, 0.0], scale=(first, 0.3))
    swings = np.maximum(first - 2 * friction / stiffness * np.arange(12), 0)
    swings[swings <= friction / stiffness] = swings[swings <= friction / stiffness].max()
    signs = (-1.0) ** np.minimum(np.arange(12), np.argmax(swings == swings.min()))
    np.testing.assert_allclose(
        moved.displacement[:, 0], signs * swings, rtol=0, atol=1e-6 * first
    )
    assert (moved.mode[6:] == 0).all()
    assert np.abs(moved.velocity[6:]).max() < 1e-9


def test_a_pendulum_swings_as_long_as_the_elliptic_integral_says():
    stiffness, inertia, angle = 30.0, 1.2, 2.1
    rig = Rig((inertia,), (Element("j0", -1, 0, stiffness, 0.0),), "rad")
    nothing = Signal.through(np.zeros(4000), 400.0)
    swing = System(
        rig, (Placed(LAWS["pendulum_sine"], "j0", {"k": stiffness}),), {0: nothing}, ()
    )
    period = 4 * ellipk(np.sin(angle / 2) ** 2) * np.sqrt(inertia / stiffness)
    moved = move(swing, period * np.arange(4) / 2, [angle, 0.0], scale=(1.0, 5.0))
    np.testing.assert_allclose(
        moved.displacement[:, 0], angle * np.array([1, -1, 1, -1]), rtol=1e-6
    )


@pytest.mark.long
@pytest.mark.parametrize("name", ["coulomb", "stribeck", "wedge_friction"])
def test_what_goes_into_a_sliding_rig_is_stored_or_lost(name):
    effect = of_kind(name)
    times = np.arange(24000) / 8000.0
    moved = move(system(effect), times, scale=SIZES)
    elongation = moved.displacement @ RIG.elongations().T
    speed = moved.velocity @ RIG.elongations().T
    law, e, v = effect.parameters, elongation[:, 1], speed[:, 1]
    most = {
        "coulomb": lambda: law["friction_n"] + 0 * v,
        "stribeck": lambda: (
            law["friction_n"]
            + (law["static_n"] - law["friction_n"]) * np.exp(-((v / law["vs_m_per_s"]) ** 2))
        ),
        "wedge_friction": lambda: law["mu"] * np.abs(e),
    }[name]()
    lost = most * np.abs(v) + speed**2 @ [2.3, 2.2]
    power = PUSH.at(times) * moved.velocity[:, 1] - lost
    stored = (moved.velocity**2 @ [1.9, 2.1] + elongation**2 @ [4100.0, 3900.0]) / 2
    gained = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2)]) / 8000.0
    np.testing.assert_allclose(stored, gained, rtol=0, atol=2e-4 * stored.max())
    assert 0.001 < (moved.mode == 0).mean() < 0.9


def test_friction_that_sticks_pulls_no_more_than_it_can_hold():
    effect = Placed(LAWS["coulomb"], "j1", {"friction_n": 0.8})
    moved = move(system(effect), TIMES, scale=SIZES)
    elongation = moved.displacement @ RIG.elongations().T
    speed = moved.velocity @ RIG.elongations().T
    others = PUSH.at(TIMES) - 3900.0 * elongation[:, 1] - 2.2 * speed[:, 1]
    friction = others - 2.1 * moved.acceleration[:, 1]
    sticks = moved.mode == 0
    assert 0.1 < sticks.mean() < 0.9
    assert np.abs(friction[sticks]).max() <= 0.8 * (1 + 1e-6)
    np.testing.assert_allclose(friction[~sticks], 0.8 * moved.mode[~sticks], atol=1e-9)
    assert np.abs(speed[sticks, 1]).max() < 1e-9


@pytest.mark.parametrize("rubs", [False, True])
def test_a_spring_that_gives_way_is_said_to_diverge(rubs):
    weak = Placed(LAWS["cubic_softening"], "j1", {"k3_n_per_m3": -1e10})
    beside = [dataclasses.replace(of_kind("coulomb"), place="j0")] if rubs else []
    with pytest.raises(Diverged):
        move(system(weak, *beside), TIMES, scale=SIZES)


def test_two_dry_frictions_are_refused():
    both = [dataclasses.replace(of_kind("coulomb"), place=p) for p in ("j0", "j1")]
    with pytest.raises(ValueError, match="Two dry frictions"):
        move(system(*both), TIMES, scale=SIZES)

"""How far an effect stands above the noise: no further than constants could not take it."""

import dataclasses

import numpy as np
import pytest

from tests.blind.cases import build
from tests.blind.design import draw_design
from tests.blind.linear import linear_motion
from tests.blind.rig import Element, Rig
from tests.blind.sensing import Sensor
from tests.blind.signals import Signal, excitation, knot_rate
from tests.blind.unexplained import Seen, unexplained
from tests.blind.world import ON_BASE

RATE_HZ, SECONDS = 100.0, 60.0
TOLERANCE = (0.05, 0.10)
LIGHT = Rig((2.0,), (Element("j0", -1, 0, 900.0, 0.6),))
SENSORS = (Sensor("acceleration", 0),)


def shaken(rig, seed):
    """One mass on a base that shakes at random, about its resonance."""
    knots_hz = knot_rate(RATE_HZ, 6.0)
    rng = np.random.default_rng(seed)
    base = Signal.through(excitation("random", (1.5, 6.0), SECONDS, knots_hz, rng), knots_hz)
    stride, count = round(knots_hz / RATE_HZ), round(RATE_HZ * SECONDS) - 10
    relative = linear_motion(rig, {}, base, stride * (count - 1) + 1)[2][::stride]
    outputs = relative[:, :1] + base.at(np.arange(count) / RATE_HZ)[:, None]
    noise = outputs.std(axis=0) * 1e-2
    return Seen({}, base, 0, stride, outputs, noise)


@pytest.mark.parametrize(
    "share",
    [
        -0.08,
        0.05,
        *(pytest.param(s, marks=pytest.mark.long) for s in (-0.05, -0.02, 0.02, 0.09)),
    ],
)
def test_a_mass_on_a_shaken_base_is_what_its_constants_make_of_it(share):
    """Its motion is told by stiffness and damping over mass; phases slip on the way there."""
    heavy = dataclasses.replace(LIGHT, masses=(LIGHT.masses[0] * (1 + share),))
    seen = [shaken(heavy, seed) for seed in (1, 2)]
    ratio, factors = unexplained(seen, LIGHT, LIGHT, SENSORS, TOLERANCE, free_start=False)
    assert ratio < -30.0
    assert factors == pytest.approx(1 / (1 + share), rel=1e-4)


def test_a_mass_beyond_what_constants_may_do_is_seen():
    heavy = dataclasses.replace(LIGHT, masses=(LIGHT.masses[0] * 1.2,))
    ratio, _ = unexplained(
        [shaken(heavy, 1)], LIGHT, LIGHT, SENSORS, TOLERANCE, free_start=False
    )
    assert ratio > 10.0


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2, 3))]
)
def test_a_mass_that_constants_could_stand_for_is_drawn_beyond_what_is_claimed(seed):
    rng = np.random.default_rng(seed)
    designs = (draw_design("listed", ("added_mass",), rng) for _ in range(1000))
    design = next(d for d in designs if (d.size, d.drive) == (1, ON_BASE))
    world = build("a", design, seed).world
    # What cannot be built as it was asked is drawn anew.
    if (world.rig.size, world.driven) == (1, (ON_BASE,)):
        share = world.effects[0].parameters["dm_kg"] / world.rig.masses[0]
        above = world.rig.elements[0].stiffness / world.nominal.elements[0].stiffness - 1
        assert share - max(above, 0.0) >= max(0.08, 4 * world.tolerance[0]) - 1e-9


@pytest.mark.parametrize(
    "seed",
    [2, *(pytest.param(seed, marks=pytest.mark.long) for seed in (0, 1, 3, 4, 5, 6, 7))],
)
def test_what_a_softer_spring_has_lost_is_beyond_what_is_claimed_of_it(seed):
    design = draw_design("listed", ("stiffness_loss",), np.random.default_rng(seed))
    world = build("a", design, seed).world
    (loss,) = world.effects
    pairs = zip(world.rig.elements, world.nominal.elements, strict=True)
    true, claimed = next(pair for pair in pairs if pair[0].id == loss.place)
    left = (true.stiffness - loss.parameters["dk_n_per_m"]) / claimed.stiffness
    assert left <= 1 - 4 * world.tolerance[0] + 1e-9

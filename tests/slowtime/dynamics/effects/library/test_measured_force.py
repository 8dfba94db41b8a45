"""A measured surface is what its equation says, is differentiated, and goes on straight."""

import dataclasses

import numpy as np
import pytest
from scipy.interpolate import BSpline

from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import DescriptionError, Input, Sensor
from slowtime.dynamics.effects import (
    Effect,
    Motion,
    Place,
    catalogue,
    force_along,
    read_effects,
)
from slowtime.dynamics.effects.library.measured_force import (
    COARSE,
    FINE,
    MIXED,
    SPEED,
    TERMS,
)
from slowtime.dynamics.plant import Plant
from slowtime_services.models.model_reader import read_description
from slowtime_services.models.model_writer import write_model

KIND, REMEMBERS = catalogue()["measured_force"], catalogue()["measured_force_with_memory"]
SCALES = {
    "vs_m_per_s": 0.01, "eq_m": 2e-4, "centre_m": 2e-4, "dense_m": 5e-4, "low_m": -2e-3,
    "high_m": 3e-3, "dense_m_per_s": 0.02, "high_m_per_s": 0.1, "spread_n": 4.0,
}  # fmt: skip
MEMORY = {"path_m": 1e-3, "lag_s": 0.05, "lag_of": 0.0, "level_s": 0.2, "level_mean": 0.05}
GROUPS = {group: [name for name, _ in terms] for group, terms in TERMS}


def motion(e, v):
    e, v = np.broadcast_arrays(np.asarray(e, dtype=float), np.asarray(v, dtype=float))
    return Motion(e=e, v=v, a=np.zeros(e.shape), times=np.arange(len(e)) / 500.0)


def level(group):
    """Coefficients of a curve that is 1 throughout."""
    return {next(name for name in GROUPS[group] if name.endswith("1_n")): 1.0}


def warp(z):
    return np.sign(z) * (np.sqrt(1 + 2 * np.abs(z)) - 1)


@pytest.mark.parametrize("group", ["position", "speed"])
def test_the_first_coefficient_is_a_constant_within_and_beyond_the_range(group):
    seen = motion(np.linspace(-6e-3, 6e-3, 41), np.linspace(0.3, -0.3, 41))
    np.testing.assert_allclose(force_along(KIND, SCALES | level(group), seen), 1.0, rtol=1e-9)


@pytest.mark.parametrize(("group", "intervals"), [("position", FINE), ("speed", SPEED)])
def test_curves_are_the_splines_of_another_library_over_the_warped_range(group, intervals):
    rng = np.random.default_rng(1)
    weights = rng.standard_normal(intervals + 3)
    steps = np.diff(weights, prepend=0.0).tolist()
    own = dict(zip(GROUPS[group][1:], steps, strict=True))
    if group == "position":
        low, high, centre, dense = (
            SCALES[n] for n in ("low_m", "high_m", "centre_m", "dense_m")
        )
    else:
        high, dense = SCALES["high_m_per_s"], SCALES["dense_m_per_s"]
        low, centre = -high, 0.0
    value = np.linspace(low, high, 101)[1:-1]
    least, most = warp((low - centre) / dense), warp((high - centre) / dense)
    at = (warp((value - centre) / dense) - least) / (most - least) * intervals
    told = BSpline(np.arange(-3, intervals + 4), weights, 3)(at)
    seen = motion(value, 0.0) if group == "position" else motion(0.0, value)
    np.testing.assert_allclose(force_along(KIND, SCALES | own, seen), told, atol=1e-9)


def test_products_of_groups_are_those_of_the_equation():
    e, v = np.linspace(-1.9e-3, 2.9e-3, 50), np.linspace(0.09, -0.09, 50)
    seen, s, q = motion(e, v), np.tanh(v / 0.01), np.tanh(e / 2e-4)
    y = v / 0.1
    for group, factor in (("friction", s), ("damping", y)):
        found = force_along(KIND, SCALES | level(group), seen)
        np.testing.assert_allclose(found, factor, atol=1e-9)
        assert len(GROUPS[group]) == COARSE + 3
    found = force_along(KIND, SCALES | {"q_n": 2.0, "qy_n": 3.0, "x_n": 5.0}, seen)
    np.testing.assert_allclose(found, 2 * q + 3 * q * y + 5 * e / 3e-3, atol=1e-9)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_curves_go_straight_on_beyond_the_range(side):
    rng = np.random.default_rng(2)
    own = dict(zip(GROUPS["position"][1:], rng.standard_normal(FINE + 3).tolist(), strict=True))
    edge = 3e-3 if side > 0 else -2e-3
    out = edge + side * np.array([0.0, 1e-3, 2e-3, 4e-3])
    found = force_along(KIND, SCALES | own, motion(out, 0.0))
    np.testing.assert_allclose(np.diff(found) / np.array([1, 1, 2]), found[1] - found[0])
    back = force_along(KIND, SCALES | own, motion([edge - side * 5e-4], 0.0))[0]
    assert (found[0] - back) / 5e-4 == pytest.approx((found[1] - found[0]) / 1e-3)


def test_memory_of_time_forgets_as_an_exponential_does():
    t = np.arange(200) / 500.0
    seen = Motion(e=0.02 * t, v=np.full(200, 0.02), a=np.zeros(200), times=t)
    found = force_along(REMEMBERS, SCALES | MEMORY | {"r_n": 5.0}, seen)
    np.testing.assert_allclose(found, (1 - np.exp(-t / 0.05)) * 5 * 0.02 / 0.1, atol=1e-6)
    held = force_along(REMEMBERS, SCALES | MEMORY | {"w_n": 5.0}, seen)
    np.testing.assert_allclose(held, 5 * (1 - np.exp(-0.02 * t / 1e-3)), atol=1e-5)


def test_a_level_follows_the_recent_vibration():
    t = np.arange(400) / 500.0
    seen = Motion(e=0.02 * t, v=np.full(400, 0.02), a=np.zeros(400), times=t)
    recent = (0.02 / 0.1) ** 2 * (1 - np.exp(-t / 0.2))
    level = recent / (recent + 0.05)
    for name, factor in (("xl1_n", 0.02 * t / 3e-3), ("yl_n", 0.02 / 0.1)):
        found = force_along(REMEMBERS, SCALES | MEMORY | {name: 5.0}, seen)
        inside = 0.02 * t < SCALES["high_m"]
        np.testing.assert_allclose(found[inside], (5 * factor * level)[inside], atol=1e-6)


def test_a_level_keeps_the_largest_elongation():
    t = np.arange(1000) / 500.0
    size = np.where(t < 0.5, 2.4e-3, 0.9e-3)
    seen = Motion(
        e=size * np.sin(40 * t), v=40 * size * np.cos(40 * t), a=np.zeros(1000), times=t
    )
    own = SCALES | MEMORY | {"level_s": 0.004, "level_of": 1.0, "yl_n": 5.0}
    found = force_along(REMEMBERS, own, seen)
    told = 5 * (2.4 / 3) * seen.v / 0.1
    np.testing.assert_allclose(found[500:], told[500:], atol=0.01 * np.abs(told).max())


def test_a_level_of_age_goes_on_from_record_to_record():
    for start in (0.0, 50.0):
        t = start + np.arange(200) / 500.0
        seen = Motion(e=np.full(200, 3e-3), v=np.zeros(200), a=np.zeros(200), times=t)
        own = SCALES | MEMORY | {"level_s": 20.0, "level_of": 2.0, "xl1_n": 2.0, "xl2_n": 3.0}
        level = 1 - np.exp(-t / 20.0)
        np.testing.assert_allclose(
            force_along(REMEMBERS, own, seen), (2 + 3 * level) * level, atol=1e-9
        )


def test_a_file_without_a_level_is_the_surface_that_it_was():
    own = random_surface(REMEMBERS, np.random.default_rng(9))
    without = {n: v for n, v in own.items() if not n.startswith(("level_", "xl", "yl"))}
    rng = np.random.default_rng(10)
    seen = motion(2e-3 * rng.uniform(-1, 1, 50), 0.1 * rng.uniform(-1, 1, 50))
    silent = dict.fromkeys(("xl1_n", "xl2_n", "xl3_n", "yl_n"), 0.0)
    np.testing.assert_array_equal(
        force_along(REMEMBERS, without, seen),
        force_along(REMEMBERS, own | silent | {"level_of": 1.0}, seen),
    )


def random_surface(kind, rng, **options):
    """Coefficients of either sign, or of one where the options say so."""
    own = {}
    for one in kind.parameters:
        if one.fitted:
            low, high = one.bounds(options)
            own[one.name] = float(np.clip(rng.standard_normal(), low, high))
    if options.get("monotone_e") or options.get("monotone_v"):
        own |= dict.fromkeys(set(MIXED) & set(kind.names), 0.0)
    return SCALES | (MEMORY if kind is REMEMBERS else {}) | own | options


@pytest.mark.parametrize("kind", [KIND, REMEMBERS], ids=lambda kind: kind.name)
@pytest.mark.parametrize("parity", [-1.0, 1.0])
def test_an_odd_surface_is_odd_to_rounding_and_an_even_one_even(kind, parity):
    rng = np.random.default_rng(5)
    t = np.arange(400) / 500.0
    e = 4e-3 * np.sin(7 * t) + 1e-3 * np.sin(31 * t)
    v = 28e-3 * np.cos(7 * t) + 31e-3 * np.cos(31 * t)
    own = random_surface(kind, rng, parity=parity)
    there = {}
    for side in (1.0, -1.0):
        seen = Motion(e=side * e, v=side * v, a=np.zeros(400), times=t)
        there[side] = force_along(kind, own, seen)
    np.testing.assert_array_equal(there[1.0], parity * there[-1.0])
    assert np.ptp(there[1.0]) > 0


def test_the_odd_and_the_even_part_are_the_surface():
    rng = np.random.default_rng(6)
    own = random_surface(KIND, rng)
    seen = motion(4e-3 * rng.uniform(-1, 1, 200), 0.15 * rng.uniform(-1, 1, 200))
    odd, even = (force_along(KIND, own | {"parity": side}, seen) for side in (-1.0, 1.0))
    np.testing.assert_allclose(odd + even, force_along(KIND, own, seen), atol=1e-12)


@pytest.mark.parametrize("parity", [-1.0, 0.0])
@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_a_monotone_surface_is_monotone_at_every_point(way, parity):
    """Within and beyond the measured range, along either variable, whatever the other."""
    rng = np.random.default_rng(7)
    own = random_surface(KIND, rng, monotone_e=way, monotone_v=-way, parity=parity)
    e, v = np.linspace(-6e-3, 6e-3, 241), np.linspace(-0.3, 0.3, 241)
    least = 1e-12 * np.abs(force_along(KIND, own, motion(e, 0.0))).max()
    for share in (-1.0, -0.3, 0.0, 0.5, 1.0):
        over_e = force_along(KIND, own, motion(e, 0.3 * share))
        over_v = force_along(KIND, own, motion(6e-3 * share, v))
        assert (way * np.diff(over_e) >= -least).all()
        assert (-way * np.diff(over_v) >= -least).all()
        assert np.ptp(over_e) > 0.1
        assert np.ptp(over_v) > 0.1


def test_a_file_without_options_is_the_surface_that_it_was():
    rng = np.random.default_rng(8)
    own = random_surface(KIND, rng)
    assert not {"parity", "monotone_e", "monotone_v"} & own.keys()
    seen = motion(4e-3 * rng.uniform(-1, 1, 50), 0.15 * rng.uniform(-1, 1, 50))
    plain = dict.fromkeys(("parity", "monotone_e", "monotone_v"), 0.0)
    np.testing.assert_array_equal(
        force_along(KIND, own, seen), force_along(KIND, own | plain, seen)
    )


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (
            {"monotone_e": 1.0, "g5_n": -2.0},
            r"`g5_n` is -2 and `monotone_e` is 1; .*at least 0",
        ),
        ({"monotone_v": -1.0, "h3_n": 2.0}, r"`h3_n` is 2 and `monotone_v` is -1; .*at most 0"),
        ({"monotone_e": 1.0, "mu4_n": 1.0}, r"`mu4_n` is 1 and `monotone_e` is 1; allowed: 0"),
        ({"monotone_v": 1.0, "parity": 1.0}, r"Give parity -1 or 0, or monotone_v 0"),
        ({"parity": 0.5}, r"`parity` is 0.5; allowed: -1 or 0 or 1"),
    ],
)
def test_coefficients_that_contradict_the_shape_are_refused(given, told):
    place = Place("element", chain([2.0], [800.0]).elements[0].id)
    with pytest.raises(DescriptionError, match=told):
        read_effects(rig(Effect(KIND.name, place, SCALES | given)))


def test_coefficients_of_a_monotone_surface_are_bounded_in_a_fit():
    place = Place("element", chain([2.0], [800.0]).elements[0].id)
    shape = {"monotone_e": 1.0, "monotone_v": -1.0}
    plant = Plant.of(rig(Effect(KIND.name, place, SCALES | shape)))
    ends = {
        name: (plant.entries["effect", 0, name].low, plant.entries["effect", 0, name].high)
        for name in ("g1_n", "g2_n", "x_n", "y_n", "h4_n")
    }
    free = (-np.inf, np.inf)
    rises, falls = (0.0, np.inf), (-np.inf, 0.0)
    assert ends == {"g1_n": free, "g2_n": rises, "x_n": rises, "y_n": falls, "h4_n": falls}


def rig(effect):
    return dataclasses.replace(
        chain([2.0], [800.0], dampings_n_s_per_m=[1.6]),
        inputs=(Input(channel="u", kind="force", node="m1", unit="N"),),
        sensors=(Sensor(channel="x", quantity="displacement", node="m1", unit="m"),),
        effects=(effect.entry(),),
    )


@pytest.fixture(params=["measured_force", "measured_force_with_memory"])
def effect(request):
    rng = np.random.default_rng(3)
    kind = catalogue()[request.param]
    own = {p.name: 0.3 * rng.standard_normal() for p in kind.parameters if p.fitted}
    more = MEMORY if kind is REMEMBERS else {"parity": -1.0}
    place = Place("element", chain([2.0], [800.0]).elements[0].id)
    return Effect(kind.name, place, SCALES | more | own)


def test_a_model_file_keeps_a_surface_and_the_simulator_runs_it(effect, tmp_path):
    model = rig(effect)
    write_model(tmp_path / "model.yaml", model)
    again = read_description(tmp_path / "model.yaml")
    push = np.random.default_rng(4).standard_normal((300, 1))
    runs = [(p := Plant.of(d)).simulate(p.values, push, 200.0) for d in (model, again)]
    np.testing.assert_array_equal(runs[0], runs[1])
    bare = Plant.of(dataclasses.replace(model, effects=()))
    assert np.std(runs[0] - bare.simulate(bare.values, push, 200.0)) > 0.01 * np.std(runs[0])


def test_derivatives_are_those_of_finite_differences(effect):
    plant = Plant.of(rig(effect))
    push = np.random.default_rng(5).standard_normal((200, 1))
    free = [name for name, entry in plant.entries.items() if entry.fitted and len(name) == 3]
    told = plant.sensitivities(plant.values, push, 200.0, free)[1]
    for name in free[:: max(len(free) // 12, 1)]:
        at = plant.parameters.index(name)
        ends = []
        for step in (1e-4, -1e-4):
            values = plant.values.copy()
            values[at] += step
            ends.append(plant.simulate(values, push, 200.0))
        slope = (ends[0] - ends[1])[:, 0] / 2e-4
        found = told[:, 0, free.index(name)]
        assert np.max(np.abs(found - slope)) < 5e-3 * np.max(np.abs(slope)) + 1e-9, name


def test_coefficients_have_a_prior_of_the_spread_that_the_surface_states(effect):
    plant = Plant.of(rig(effect))
    sds = {entry.sd for name, entry in plant.entries.items() if entry.fitted and len(name) == 3}
    assert sds == {4.0}

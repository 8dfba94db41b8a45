"""Laws named from the force that an imposed motion took; truth by increments of the motion."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.imposed_motion.records import (
    clock_errors,
    force_record,
    is_imposed,
    rig_of,
)
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor
from tests.slowtime.discrepancy.imposed_motion.rigs import RATE, RIG, C, K


def motion(seed, seconds=30.0):
    """Sweep with two amplitudes, from rest; displacement and its exact rate."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE)) / RATE
    e, v = np.zeros(len(t)), np.zeros(len(t))
    for hertz, size in zip((0.31, 0.53, 0.87), rng.uniform(0.1, 0.4, 3), strict=True):
        turn, phase = 2 * np.pi * hertz, rng.uniform(0, 6)
        e += size * np.sin(turn * t + phase)
        v += size * turn * np.cos(turn * t + phase)
    return e, v


def slider(e, limit, reach, play=0.0):
    """Elastic, perfectly plastic, with play: by increments."""
    z, found = 0.0, []
    for step in np.diff(e, prepend=e[0]):
        z = min(max(z + step, -play - reach), play + reach)
        found.append(limit * np.sign(z) * max(abs(z) - play, 0.0) / reach)
    return np.array(found)


DRIVEN = dataclasses.replace(
    RIG,
    inputs=(Input(channel="x", kind="imposed_displacement", node="m1", unit="mm"),),
    sensors=(Sensor(channel="f", quantity="force", node="m1", unit="kN"),),
)


LAWS = {
    "coulomb": lambda e, v: 3.0 * np.sign(v),
    "quadratic_damping": lambda e, v: 4.0 * np.abs(v) * v,
    "cubic_hardening": lambda e, v: 80.0 * e**3,
    "friction_in_series_with_spring": lambda e, v: slider(e, 3.0, 0.08),
    "friction_with_play": lambda e, v: slider(e, 3.0, 0.05, 0.06),
}
STRENGTHS = {
    "coulomb": ("friction_n", 3.0),
    "quadratic_damping": ("c2_n_s2_per_m2", 4.0),
    "cubic_hardening": ("k3_n_per_m3", 80.0),
    "friction_in_series_with_spring": ("friction_n", 3.0),
    "friction_with_play": ("friction_n", 3.0),
}


UNITS = {"friction_n": "N", "c2_n_s2_per_m2": "N s^2/m^2", "k3_n_per_m3": "N/m^3"}


def trial(law, seed, noise=0.05):
    e, v = motion(seed)
    rng = np.random.default_rng(100 + seed)
    force = K * e + C * v + law(e, v) + noise * rng.standard_normal(len(e))
    return Trial(inputs=force[:, None], outputs=e[:, None], rate_hz=RATE)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=pytest.mark.gate)
        if n == "coulomb"
        else pytest.param(n, marks=pytest.mark.long)
        for n in LAWS
    ],
)
def test_the_law_is_named_or_among_the_undecided_with_its_strength(name):
    law = LAWS[name]
    campaign = Campaign(description=RIG, trials=(trial(law, 1),), holdout=(trial(law, 2),))
    found = diagnose(campaign)
    named = [one.effect.kind for one in found.effects]
    assert name in {*named, *(one.effect for one in found.undecided)}
    parameter, true = STRENGTHS[name]
    numbers = [one.numbers[parameter] for one in found.effects if parameter in one.numbers]
    assert numbers
    assert numbers[0].unit == UNITS[parameter]
    assert numbers[0].value == pytest.approx(true, rel=0.1)
    assert found.gap.augmented < 0.3 * found.gap.refitted_nominal
    (trace,) = found.traces
    assert trace.of_force
    left = np.std(trace.measured - trace.augmented) / np.std(trace.measured)
    assert left == pytest.approx(found.gap.augmented, rel=0.02)


@pytest.mark.long
def test_laws_of_an_angle_are_stated_as_torques():
    rig = dataclasses.replace(
        RIG,
        unit_of_coordinate="rad",
        inputs=(dataclasses.replace(RIG.inputs[0], unit="N m"),),
        sensors=(dataclasses.replace(RIG.sensors[0], unit="rad"),),
    )
    law = LAWS["coulomb"]
    campaign = Campaign(description=rig, trials=(trial(law, 1),), holdout=(trial(law, 2),))
    (named,) = diagnose(campaign).effects
    assert named.numbers["friction_n"].unit == "N m"
    assert named.numbers["friction_n"].text.endswith(" N m")


@pytest.mark.long
def test_a_spring_and_a_damper_lack_nothing():
    campaign = Campaign(
        description=RIG, trials=(trial(lambda e, v: 0 * e, 1),),
        holdout=(trial(lambda e, v: 0 * e, 2),),
    )  # fmt: skip
    found = diagnose(campaign)
    assert found.verdict == "nothing_missing"
    assert not found.effects


def test_a_force_that_follows_no_law_is_unknown():
    def strange(e, v):
        return 20.0 * np.sin(40.0 * e) * np.cos(9.0 * v)

    campaign = Campaign(
        description=RIG, trials=(trial(strange, 1),), holdout=(trial(strange, 2),)
    )
    assert diagnose(campaign).verdict == "unknown_effect"


def test_a_mass_that_matters_is_no_rig_of():
    heavy = dataclasses.replace(
        RIG, nodes=tuple(dataclasses.replace(one, mass_kg=5.0) for one in RIG.nodes)
    )
    assert is_imposed(RIG, [trial(LAWS["coulomb"], 1)])
    assert not is_imposed(heavy, [trial(LAWS["coulomb"], 1)])
    assert rig_of(chain([1.0, 1.0], [1.0, 1.0])) is None


def test_inertia_is_taken_off_the_force_and_the_rate_is_that_of_the_motion():
    e, v = motion(1)
    rig = rig_of(RIG)
    assert rig is not None
    found = force_record(rig, trial(LAWS["coulomb"], 1, noise=0.0))
    inner = slice(20, -20)
    np.testing.assert_allclose(found.motion.v[inner], v[inner], atol=2e-3 * np.abs(v).max())
    np.testing.assert_allclose(found.motion.e, e)


def exchanged(one, unit_x=1e3, unit_f=1e-3):
    """The same record with the motion as input [mm] and the force as output [kN]."""
    return Trial(inputs=unit_x * one.outputs, outputs=unit_f * one.inputs, rate_hz=RATE)


@pytest.mark.long
def test_the_motion_as_input_gives_the_answer_that_the_force_as_input_gives():
    law = LAWS["quadratic_damping"]
    given = trial(law, 1), trial(law, 2)
    one = diagnose(Campaign(description=RIG, trials=given[:1], holdout=given[1:]))
    turned = [exchanged(record) for record in given]
    other = diagnose(
        Campaign(description=DRIVEN, trials=tuple(turned[:1]), holdout=tuple(turned[1:]))
    )
    assert [a.effect.kind for a in other.effects] == [a.effect.kind for a in one.effects]
    for name, number in one.effects[0].numbers.items():
        assert other.effects[0].numbers[name].value == pytest.approx(number.value, rel=1e-3)
    assert other.gap.augmented == pytest.approx(one.gap.augmented, rel=1e-3)


def test_a_motion_that_is_imposed_is_so_however_heavy_the_node():
    heavy = dataclasses.replace(
        DRIVEN, nodes=(dataclasses.replace(DRIVEN.nodes[0], mass_kg=5.0),)
    )
    e, _ = motion(1)
    acceleration = np.gradient(np.gradient(e)) * RATE**2
    force = K * e + 5.0 * acceleration
    record = Trial(inputs=1e3 * e[:, None], outputs=1e-3 * force[:, None], rate_hz=RATE)
    assert is_imposed(heavy, [record])
    rig = rig_of(heavy)
    assert rig is not None
    # Polynomials over six hundredths of a period flatten the acceleration of the fastest tone.
    left = force_record(rig, record).force - K * e
    assert left[50:-50].std() < 0.04 * (5.0 * acceleration).std()


@pytest.mark.parametrize(
    ("sensor", "sign"), [({"element": "k1"}, 1.0), ({"node": "base"}, -1.0)], ids=str
)
def test_a_force_in_the_spring_and_a_reaction_of_the_base_have_no_inertia(sensor, sign):
    described = dataclasses.replace(
        DRIVEN, sensors=(Sensor(channel="f", quantity="force", unit="N", **sensor),)
    )
    e, _ = motion(1)
    record = Trial(inputs=1e3 * e[:, None], outputs=sign * K * e[:, None], rate_hz=RATE)
    rig = rig_of(described)
    assert rig is not None
    np.testing.assert_allclose(force_record(rig, record).force, K * e, rtol=1e-12)


def test_an_imposed_velocity_is_integrated_about_its_mean():
    described = dataclasses.replace(
        DRIVEN,
        inputs=(Input(channel="v", kind="imposed_velocity", node="m1", unit="m/s"),),
        sensors=(Sensor(channel="f", quantity="force", node="m1", unit="N"),),
    )
    e, v = motion(1)
    rig = rig_of(described)
    assert rig is not None
    record = force_record(
        rig, Trial(inputs=(v - v.mean())[:, None], outputs=K * e[:, None], rate_hz=RATE)
    )
    told = e - v.mean() * np.arange(len(e)) / RATE
    assert np.std(record.motion.e - (told - told.mean())) < 0.01 * np.std(e)
    np.testing.assert_array_equal(record.motion.v, v - v.mean())


@pytest.mark.parametrize(
    ("factor", "verdict"), [(1.02, "nothing_missing"), (0.5, "parameters_only")]
)
def test_a_spring_outside_its_tolerance_is_told_with_its_stiffness(factor, verdict):
    spring = lambda e, v: (factor - 1) * K * e  # noqa: E731
    campaign = Campaign(
        description=RIG, trials=(trial(spring, 1),), holdout=(trial(spring, 2),)
    )
    found = diagnose(campaign)
    assert found.verdict == verdict
    assert found.effects == ()
    if verdict == "nothing_missing":
        assert found.moved == {}
        return
    (stiffness,) = found.moved.values()
    assert list(found.moved) == ["stiffness k1"]
    assert abs(stiffness.value - factor * K) < 4 * stiffness.sd
    assert 0 < stiffness.sd < 0.02 * K
    assert stiffness.text in found.sentence


@pytest.mark.parametrize("factor", [1.0, 60.0])
def test_the_inertia_of_a_node_tells_the_clock_of_its_record(factor):
    """A node of 20 kg whose motion is read with a clock that is slower by a factor."""
    heavy = dataclasses.replace(
        RIG, nodes=(dataclasses.replace(RIG.nodes[0], mass_kg=20.0 / factor**2),)
    )
    given = trial(lambda e, v: 0 * e, 3)
    t, e = given.times_s, given.outputs[:, 0]
    force = given.inputs[:, 0] + 20.0 * np.gradient(np.gradient(e, t), t)
    read = dataclasses.replace(given, inputs=force[:, None])
    clocks = (1.0, 60.0, 1000.0)
    rig = rig_of(heavy)
    assert rig is not None
    errors = clock_errors(rig, read, clocks)
    assert clocks[int(np.argmin(errors))] == factor
    assert errors.min() < 0.1

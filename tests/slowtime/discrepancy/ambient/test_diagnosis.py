"""Ambient campaigns: what can be said is said, and no more."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

from slowtime.discrepancy.ambient.diagnosis import _bands_text
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.dynamics.description import (
    Description,
    Node,
    Sensor,
    Spring,
    Tolerance,
    assemble,
)
from slowtime.dynamics.simulation import ambient_structure

RATE, SECONDS = 64.0, 120.0


def rig():
    return Description(
        name="one",
        nodes=(Node(id="m1", mass_kg=1.0),),
        elements=(
            Spring(
                id="j0", between=("base", "m1"), stiffness_n_per_m=900.0, damping_n_s_per_m=1.4
            ),
        ),
        sensors=(Sensor(channel="a1", quantity="acceleration", node="m1", unit="m/s^2"),),
        tolerance=Tolerance(stiffness=0.03, damping=0.3),
    )


def answered(stiffness=900.0, tone=0.0):
    rng = np.random.default_rng(5)
    true = with_values(rig(), {("stiffness", "j0"): stiffness})
    samples = round(RATE * SECONDS)
    outputs = ambient_structure(assemble(true), samples, RATE, rng, force_psd=np.array([1e-2]))
    outputs = outputs + 0.05 * rng.standard_normal(outputs.shape)
    outputs[:, 0] += tone * np.sin(2 * np.pi * 7.0 * np.arange(samples) / RATE)
    trial = Trial(inputs=np.zeros((samples, 0)), outputs=outputs, rate_hz=RATE)
    return diagnose(Campaign(description=rig(), trials=(trial,), holdout=()))


@pytest.mark.parametrize(
    ("change", "verdict"),
    [
        ({}, "nothing_missing"),
        ({"stiffness": 680.0}, "undecided"),
        ({"tone": 0.5}, "unknown_effect"),
    ],
)
def test_spectra_tell_whether_they_are_the_models(change, verdict):
    found = answered(**change)
    assert found.verdict == verdict
    assert found.experiment is not None
    assert "Measure what drives" in found.sentence
    if verdict == "unknown_effect":
        assert any(low <= 7.0 <= high for low, high in found.when.bands_hz)
    if verdict == "undecided":
        # A frequency alone does not tell a lost stiffness from an added mass.
        named = {(one.effect, one.place.id) for one in found.undecided}
        assert {("stiffness_loss", "j0"), ("added_mass", "m1")} <= named
        assert found.gap.augmented < found.gap.nominal / 2


def vibrated(level, seed, friction_n=0.0, seconds=120.0, low_hz=0.5, high_hz=15.0):
    """Acceleration of the rig under a band-limited force, by an implicit Euler rule."""
    fine = 16
    rng, dt = np.random.default_rng(seed), 1 / (fine * RATE)
    count = round(seconds * RATE * fine)
    lines = np.fft.rfftfreq(count, dt)
    drawn = rng.standard_normal((2, len(lines)))
    inside = (lines > low_hz) & (lines < high_hz)
    force = np.fft.irfft(np.where(inside, drawn[0] + 1j * drawn[1], 0.0), count)
    force = (level * force / force.std()).tolist()
    mass, stiffness, damping = 1.0, 900.0, 1.4
    x = v = 0.0
    slowness = mass / dt + damping + stiffness * dt
    speeds = np.zeros(count)
    for number in range(count):
        push = force[number] + mass * v / dt - stiffness * x
        # The step's speed solves the inclusion push in slowness v + friction Sgn(v).
        v = math.copysign(max(abs(push) - friction_n, 0.0), push) / slowness
        x += dt * v
        speeds[number] = v
    acceleration = np.gradient(speeds, dt)[::fine]
    noise = 0.01 * acceleration.std() * rng.standard_normal(len(acceleration))
    outputs = (acceleration + noise)[:, None]
    return Trial(inputs=np.zeros((len(outputs), 0)), outputs=outputs, rate_hz=RATE)


def test_records_of_different_levels_and_coloured_forces_are_no_misfit():
    trials = (vibrated(1.0, 11), vibrated(4.0, 12, low_hz=2.0))
    found = diagnose(Campaign(description=rig(), trials=trials, holdout=(vibrated(2.0, 13),)))
    assert found.verdict == "nothing_missing"
    assert found.gap.refitted_nominal < 3 * found.gap.noise_floor


@pytest.mark.long
def test_dry_friction_is_named_by_how_damping_falls_with_the_level():
    friction = 0.15
    trials = tuple(vibrated(level, 20 + k, friction) for k, level in enumerate((0.6, 1.5, 5.0)))
    found = diagnose(
        Campaign(description=rig(), trials=trials, holdout=(vibrated(0.5, 29, friction),))
    )
    assert found.verdict == "missing_effect"
    (named,) = found.effects
    assert (named.effect.kind, named.effect.place.id) == ("coulomb", "j0")
    number = named.numbers["friction_n"]
    assert abs(number.value - friction) < 4 * number.sd < 0.8 * friction
    assert found.gap.augmented < found.gap.refitted_nominal
    assert any("Equivalent stiffness and damping of element j0" in one for one in found.notes)


def test_a_silent_span_is_told_without_an_input_too():
    samples = round(RATE * SECONDS)
    outputs = np.random.default_rng(6).standard_normal((samples, 1)) * 0.3
    outputs += ambient_structure(
        assemble(rig()), samples, RATE, np.random.default_rng(7), force_psd=np.array([1e-2])
    )
    outputs[900:1400] = 0.0
    trial = Trial(inputs=np.zeros((samples, 0)), outputs=outputs, rate_hz=RATE)
    campaign = Campaign(description=rig(), trials=(trial,), holdout=())
    found = diagnose(campaign)
    assert [f.fault for f in found.findings] == ["zero"]


@pytest.mark.parametrize("count", [1, 4, 5, 40])
def test_a_sentence_names_four_bands_at_most_and_counts_the_others(count):
    bands = tuple((float(k), k + 0.5 + 0.01 * k) for k in range(1, count + 1))
    told = _bands_text(bands)
    assert told.count(" to ") == min(count, 4)
    assert f"{bands[-1][0]:.3g} to {bands[-1][1]:.3g} Hz" in told  # the widest
    assert (f"{count - 4} more bands between 1 and" in told) == (count > 4)


def three_masses(**constants):
    """Three masses in a row, each with a sensor, and one spring more if asked for."""
    ends = ["base", "m1", "m2", "m3"]
    given = Description(
        name="three",
        nodes=tuple(Node(id=end, mass_kg=2.0) for end in ends[1:]),
        elements=tuple(
            Spring(id=f"j{i}", between=pair, stiffness_n_per_m=4000.0, damping_n_s_per_m=3.0)
            for i, pair in enumerate(itertools.pairwise(ends))
        ),
        sensors=tuple(
            Sensor(channel=f"a{i}", quantity="acceleration", node=f"m{i}", unit="m/s^2")
            for i in (1, 2, 3)
        ),
        tolerance=Tolerance(stiffness=0.03, damping=0.3),
    )
    return dataclasses.replace(given, **constants)


def shaken(true, seed, level=1.0, samples=4096):
    rng = np.random.default_rng(seed)
    psd = level * np.full(3, 1e-1)
    outputs = ambient_structure(assemble(true), samples, RATE, rng, force_psd=psd)
    return outputs + 0.01 * outputs.std(axis=0) * rng.standard_normal(outputs.shape)


def asked(given, records, holdout=()):
    learnt, unseen = (
        tuple(Trial(inputs=np.zeros((len(y), 0)), outputs=y, rate_hz=RATE) for y in some)
        for some in (records, holdout)
    )
    return diagnose(Campaign(description=given, trials=learnt, holdout=unseen))


def named_in(found):
    rivals = {(one.effect, one.place.id) for one in found.undecided}
    return rivals | {(one.effect.kind, one.effect.place.id) for one in found.effects}


@pytest.mark.long
def test_a_spring_between_points_that_nothing_joins_is_found_without_an_input():
    given = three_masses()
    link = Spring(id="link", between=("base", "m3"), stiffness_n_per_m=900.0)
    true = dataclasses.replace(given, elements=(*given.elements, link))
    found = asked(given, [shaken(true, 1), shaken(true, 2, 0.5)])
    assert ("missing_spring", "base-m3") in named_in(found)
    assert {place for _, place in named_in(found)} == {"base-m3"}
    assert [one.between for one in found.augmented.elements[3:]] == [("base", "m3")]
    assert [one.id for one in found.nominal.elements] == ["j0", "j1", "j2"]


@pytest.mark.long
@pytest.mark.parametrize(
    ("told", "kind", "value"),
    [
        (lambda y: 1.2 * y, "sensor_gain", 1.2),
        (lambda y: np.roll(y, 1), "sensor_delay", 1 / RATE),
    ],
)
def test_a_sensor_that_lies_is_named_without_an_input(told, kind, value):
    given = three_masses()
    records = [shaken(given, 3), shaken(given, 4)]
    for record in records:
        record[:, 1] = told(record[:, 1])
    found = asked(given, records)
    (one,) = found.effects
    assert (found.verdict, one.effect.kind, one.effect.place.id) == ("sensor_fault", kind, "a2")
    (number,) = one.numbers.values()
    assert abs(number.value - value) < 4 * number.sd < 0.1 * value


@pytest.mark.long
def test_a_mass_that_falls_is_told_from_one_that_is_wrong():
    given = three_masses()
    # Each sixth of a record has a mass of its own.
    falling = [
        with_values(given, {("mass", "m2"): 2.0 - 0.6 * (k + 0.5) / 6}) for k in range(6)
    ]
    records = [
        np.concatenate([shaken(one, seed + k, 1.0, 768) for k, one in enumerate(falling)])
        for seed in (50, 60, 70)
    ]
    found = asked(given, records[:2], records[2:])
    assert found.effects[0].effect.place.id == "m2"
    assert "mass_drift" in {kind for kind, _ in named_in(found)}
    assert "added_mass" not in {kind for kind, _ in named_in(found)}

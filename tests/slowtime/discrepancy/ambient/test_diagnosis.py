"""Ambient campaigns: what can be said is said, and no more."""

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

"""Structures that nothing holds: their runs drift, and that is no reason to bend."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.noise import has_rigid_motion, rigid_body_drift
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.refinement.constant_offsets import with_offsets
from slowtime.dynamics.description import (
    Description,
    Input,
    Node,
    Sensor,
    Spring,
    Tolerance,
)
from slowtime.dynamics.effects import catalogue
from slowtime.dynamics.plant import Plant

RATE = 200.0
KINDS = catalogue()


def drive(*effects, stiffness=0.0, damping=20.0):
    return Description(
        name="drive",
        nodes=(Node(id="cart", mass_kg=10.0),),
        elements=(
            Spring(
                id="guide",
                between=("base", "cart"),
                stiffness_n_per_m=stiffness,
                damping_n_s_per_m=damping,
            ),
        ),
        inputs=(Input(channel="force", kind="force", node="cart", unit="N"),),
        sensors=(
            Sensor(
                channel="x",
                quantity="displacement",
                node="cart",
                unit="m",
                frame="relative_to_base",
            ),
        ),
        effects=effects,
        tolerance=Tolerance(stiffness=0.0, damping=0.5, mass=0.1),
    )


def recorded(seconds, seed, *effects):
    """A record of a drive that steps to and fro, whose force has an error of its own."""
    rng = np.random.default_rng(seed)
    times = np.arange(int(seconds * RATE)) / RATE
    steps = np.repeat(rng.uniform(0.5, 1.0, 64) * np.tile([1, -1], 32), int(0.8 * RATE))
    force = 8.0 * steps[: len(times)] + 4.0 * np.sin(2 * np.pi * 1.3 * times)
    plant = Plant.of(drive(*effects), kinds=KINDS)
    acted = force + 0.1 * rng.standard_normal(len(times))
    outputs = plant.simulate(plant.values, acted[:, None], RATE)
    outputs = outputs + 1e-5 * rng.standard_normal(outputs.shape)
    return Trial(inputs=force[:, None], outputs=outputs, rate_hz=RATE)


RUBS = {"effect": "coulomb", "element": "guide", "friction_n": 2.0}
OFF = {"effect": "input_bias", "input": "force", "bias": 0.4}


def test_inputs_of_a_floating_structure_have_offsets_and_others_have_none():
    assert has_rigid_motion(drive())
    assert not has_rigid_motion(drive(stiffness=100.0))
    assert with_offsets(drive(), KINDS, decays=False).effects == ({**OFF, "bias": 0.0},)
    assert with_offsets(drive(OFF), KINDS, decays=False).effects == (OFF,)
    assert with_offsets(drive(stiffness=100.0), KINDS, decays=False).effects == ()


def test_a_sensor_of_a_free_decay_has_one_offset_whatever_else_is_wrong_with_it():
    own = {"effect": "sensor_bias", "sensor": "x", "bias": 0.01}
    gain = {"effect": "sensor_gain", "sensor": "x", "gain": 1.1}
    held = drive(stiffness=100.0)
    for given, all_of_them in (
        ((), ({**own, "bias": 0.0},)),
        ((own,), (own,)),
        ((gain,), (gain, {**own, "bias": 0.0})),
        ((gain, own), (gain, own)),
    ):
        model = dataclasses.replace(held, effects=given)
        assert with_offsets(model, KINDS, decays=True).effects == all_of_them


def test_drift_is_the_response_to_errors_of_the_force():
    trial = recorded(5.0, 1)
    drift = rigid_body_drift(drive(), (trial,))
    assert drift is not None
    frequency = np.array([0.5, 3.0])
    s = 2j * np.pi * frequency
    expected = np.abs(1 / (10.0 * s**2 + 20.0 * s)) ** 2 * drift.error_density[0][0]
    assert drift.density(0, frequency)[:, 0] == pytest.approx(expected)
    assert rigid_body_drift(drive(stiffness=100.0), (trial,)) is None


def test_accelerations_do_not_drift():
    sensor = Sensor(channel="a", quantity="acceleration", node="cart", unit="m/s^2")
    model = dataclasses.replace(drive(), sensors=(sensor,))
    drift = rigid_body_drift(model, (recorded(5.0, 1),))
    assert drift is not None
    assert drift.density(0, np.array([0.5])) == 0


def test_errors_of_the_force_are_found_in_what_they_leave():
    trial = recorded(20.0, 2)
    drift = rigid_body_drift(drive(), (trial,))
    assert drift is not None
    frequency = np.fft.rfftfreq(4000, 1 / RATE)
    error = np.exp(2j * np.pi * np.random.default_rng(3).random(len(frequency)))[:, None]
    left = drift.transfer(0, frequency)[:, :, 0] * error
    found = drift.input_errors(frequency, left, np.full(left.shape, 1e-30))
    assert found[1:100] == pytest.approx(error[1:100], rel=1e-6)
    assert found[0] == 0


def test_friction_and_offset_are_fitted_although_the_run_drifts():
    """Both came out 20 % off where friction followed the run."""
    trial = recorded(20.0, 4, RUBS, OFF)
    model = with_offsets(drive({**RUBS, "friction_n": 1.0}, damping=25.0), KINDS, decays=False)
    fit = refit(Plant.of(model, kinds=KINDS), (trial,))
    found = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    assert found["effect", 0, "friction_n"] == pytest.approx(2.0, rel=0.05)
    assert found["effect", 1, "bias"] == pytest.approx(0.4, rel=0.05)
    assert found["damping", "guide"] == pytest.approx(20.0, rel=0.03)


@pytest.mark.slow
def test_friction_of_a_drive_is_named_and_its_offset_told_after_it():
    campaign = Campaign(
        description=drive(damping=25.0),
        trials=(recorded(20.0, 4, RUBS, OFF),),
        holdout=(recorded(10.0, 5, RUBS, OFF),),
    )
    found = diagnose(campaign)
    assert found.verdict == "missing_effect"
    assert [named.effect.kind for named in found.effects] == ["coulomb", "input_bias"]
    assert found.gap.augmented < 0.5 * found.gap.refitted_nominal


@pytest.mark.slow
def test_an_offset_alone_is_a_fault_of_the_input():
    found = diagnose(Campaign(description=drive(), trials=(recorded(20.0, 6, OFF),)))
    assert found.verdict == "input_fault"
    assert [named.effect.kind for named in found.effects] == ["input_bias"]
    assert found.gap.augmented < found.gap.refitted_nominal

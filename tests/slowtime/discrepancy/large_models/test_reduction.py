"""Reduced models: what they keep, and how they are told as the large one."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.large_models import is_large, reasons_against, reduce_plainly
from slowtime.discrepancy.large_models.basis import BandModes, band_limit_hz
from slowtime.discrepancy.large_models.reduction import Kept, reduce_model
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import OpenJoint, Support, assemble
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.large_models.chains import BAND_HZ, campaign

MASSES = 60


@pytest.fixture(scope="module")
def given():
    return campaign(lambda true: None, masses=MASSES, seconds=20.0)


@pytest.fixture(scope="module")
def reduced(given):
    return reduce_plainly(given.description, given.trials, catalogue())


def test_the_band_is_that_of_the_forces(given):
    assert band_limit_hz(given.trials) == pytest.approx(BAND_HZ, rel=0.01)


def test_a_record_that_ends_amid_a_period_has_the_band_of_its_force():
    times = np.arange(1000) / 50.0
    force = np.cos(2 * np.pi * 2.025 * times)[:, None]
    trial = Trial(inputs=force, outputs=np.zeros((1000, 1)), rate_hz=50.0)
    assert band_limit_hz([trial]) == pytest.approx(2.025, abs=0.2)


def test_a_hit_at_the_begin_of_a_record_drives_all_frequencies():
    force = np.zeros((1000, 1))
    force[0] = 1.0
    trial = Trial(inputs=force, outputs=np.zeros((1000, 1)), rate_hz=50.0)
    assert band_limit_hz([trial]) > 20.0


def test_readings_are_those_of_the_large_model(given, reduced):
    trial = given.trials[0]
    few, all_of_them = (
        plant.simulate(plant.values, trial.inputs, trial.rate_hz)
        for plant in (Plant.of(reduced.small), Plant.of(given.description))
    )
    assert len(reduced.small.dofs) < MASSES
    # At first, modes above the band ring from the jump out of rest.
    off = np.std((few - all_of_them)[500:], axis=0) / np.std(all_of_them[500:], axis=0)
    assert off.max() < 3e-3


def test_directions_change_readings_as_the_constants_that_they_combine(given, reduced):
    trial = given.trials[0]
    parts = tuple(
        dataclasses.replace(one, stiffness_factor=1.02)
        if one.id == "stiffness direction 1" else one
        for one in reduced.small.elements
    )  # fmt: skip
    small = dataclasses.replace(reduced.small, elements=parts)
    models = (small, reduced.enlarged(small), given.description)
    few, whole, before = (
        plant.simulate(plant.values, trial.inputs, trial.rate_hz)
        for plant in map(Plant.of, models)
    )
    moved = np.std((whole - before)[500:], axis=0)
    assert (np.std((few - whole)[500:], axis=0) < 0.05 * moved).all()


def test_constants_that_were_fitted_are_told_in_directions(reduced):
    plant = Plant.of(reduced.small)
    name = "stiffness", "stiffness direction 1"
    moved = with_values(reduced.small, {name: 1.02})
    known = dataclasses.replace(reduced, fitted=reduced.constants_at(moved))
    values = dict(zip(plant.parameters, known.fitted_values(plant), strict=True))
    expected = dict(zip(plant.parameters, plant.values, strict=True)) | {name: 1.02}
    assert values == pytest.approx(expected)


def test_a_joint_and_its_effect_are_added_to_the_large_model(given):
    joint = OpenJoint(id="n7-n31", between=("n7", "n31"), among=9)
    large = given.description
    modes = BandModes.of(assemble(large), BAND_HZ)
    reduced = reduce_model(large, modes, {}, Kept(joints=(joint,)))
    spring = Effect("missing_spring", Place("element", "n7-n31"), {"k_n_per_m": 50.0})
    small = dataclasses.replace(reduced.small, effects=(spring.entry(),))
    found = reduced.enlarged(small)
    assert found.elements[-1].between == ("n7", "n31")
    assert found.effects == (spring.entry(),)
    assert found.nodes == large.nodes


def test_too_many_modes_in_the_band_are_refused_with_the_cure(given):
    from slowtime.discrepancy.large_models.diagnosis import MOST_MODES, reduce_for

    noisy = tuple(dataclasses.replace(one, rate_hz=400.0 * one.rate_hz) for one in given.trials)
    many = campaign(lambda true: None, masses=MOST_MODES + 5, seconds=4.0).description
    with pytest.raises(
        ValueError, match=r"modes of the model lie below .* Filter and resample"
    ):
        reduce_for(many, noisy, catalogue(), Monitor())


def test_moving_supports_are_a_reason_against(given):
    assert is_large(given.description)
    assert reasons_against(given.description) == ""
    wall = dataclasses.replace(given.description, supports=(Support(id="wall"),))
    assert "beside the base" in reasons_against(wall)

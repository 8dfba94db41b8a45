"""Sensors placed for damage: limits against other criteria, random plans, and the test."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import slowtime as st
from slowtime.evolution.assessment import AssessmentSettings, expected_modes, plan_limits
from slowtime.evolution.assessment.assessment import Comparison
from slowtime.evolution.structures import ModePrecision, PlacementProblem, place_sensors
from tests.slowtime.evolution.assessment.pyfe3d_frames import Truth

STOREYS = Path(__file__).parents[4] / "docs/examples/two_storeys.yaml"
FRAME = Truth(storeys=2)
MODES, SENSORS = 6, 6


@pytest.fixture(scope="module")
def expected():
    return expected_modes(*FRAME.model, MODES)


def seen_at(expected, sites):
    """Modes as some of the sensors see them."""
    return dataclasses.replace(
        expected,
        shapes=expected.shapes[:, sites],
        shape_sd=expected.shape_sd[:, sites],
        channels=expected.channels[sites],
    )


def problem_of(temperature_sd):
    structure, channels = FRAME.model
    precision = ModePrecision(modes=MODES, frequency_sd=1e-3, shape_sd=0.01)
    differences = dataclasses.replace(
        precision, frequency_sd=math.sqrt(2) * 1e-3, shape_sd=math.sqrt(2) * 0.01
    )
    sites = np.arange(len(channels))
    return PlacementProblem(structure, channels, sites, differences, 1.0, temperature_sd)


@pytest.mark.parametrize("temperature_sd", [0.0, 0.02])
def test_a_loss_of_one_deviation_is_that_of_the_test_of_the_assessment(
    expected, temperature_sd
):
    problem, sites = problem_of(temperature_sd), (0, 3, 9, 14)
    there = seen_at(expected, list(sites))
    settings = AssessmentSettings(temperature_sd=temperature_sd)
    test = Comparison(FRAME.model[0], there, there, settings).test
    losses = 1.0 / np.linalg.norm(test.whiten(test.slope), axis=0)
    share = 0.01 * losses.mean()
    assert problem.largest_loss(sites) == pytest.approx(losses.max() + share, rel=1e-5)


def test_gains_are_falls_of_the_largest_loss():
    problem, chosen, tried = problem_of(0.02), (0, 3, 9), np.array([1, 5, 12])
    gains = problem.gains(chosen, tried, "detection")
    falls = [
        problem.largest_loss(chosen) - problem.largest_loss((*chosen, site))
        for site in tried.tolist()
    ]
    np.testing.assert_allclose(gains, falls, rtol=1e-6)


def test_members_that_no_sensor_sees_do_not_decide():
    structure, channels = FRAME.model
    precision = ModePrecision(modes=MODES, frequency_sd=1e-3, shape_sd=0.01)
    silent = np.ones(len(FRAME.names))
    silent[0] = 0.0
    problem = PlacementProblem(structure, channels, np.arange(16), precision, silent)
    assert math.isfinite(problem.largest_loss((0, 3, 9)))
    assert len(set(place_sensors(problem, 4, criterion="detection").sites)) == 4


def test_the_plan_is_no_worse_than_other_criteria_and_random_ones(expected):
    structure, channels = FRAME.model
    problem = problem_of(0.02)

    def largest(sites):
        limits = plan_limits(structure, seen_at(expected, list(sites)))
        return max(one.loss if math.isfinite(one.loss) else 1.0 for one in limits)

    planned = largest(place_sensors(problem, SENSORS, criterion="detection").sites)
    random = np.random.default_rng(1)
    others = [place_sensors(problem, SENSORS, criterion="determinant").sites]
    others += [place_sensors(problem, SENSORS, criterion="variance").sites]
    others += [random.choice(len(channels), SENSORS, replace=False).tolist() for _ in range(4)]
    assert planned < 0.97 * min(map(largest, others))


def test_the_printed_limits_are_those_of_the_assessment():
    """The file has sensors at all sites: the promise is that of the sensors of the file."""
    precision: dict[str, Any] = {"modes": MODES, "frequency_sd": 1e-3, "shape_sd": 0.01}
    placed = st.place(STOREYS, 16, directions=("ux", "uy"), criterion="detection", **precision)
    known = {one.name: one for one in st.detection_limits(STOREYS, **precision)}
    assert len(placed.limits) == len(placed.evenly_spread_limits) == 16
    for one in placed.limits:
        assert one.loss == pytest.approx(known[one.name].loss, rel=1e-3)
    assert st.place(STOREYS, 2, modes=MODES).limits == ()


def test_fewer_false_alarms_cost_larger_losses_and_sensors_may_be_one():
    few, many = (
        st.place(
            STOREYS,
            1,
            modes=4,
            directions=("ux",),
            criterion="detection",
            frequency_sd=1e-3,
            settings=AssessmentSettings(false_alarm=level),
        ).limits
        for level in (0.001, 0.1)
    )
    for one, other in zip(few, many, strict=True):
        assert math.isnan(one.loss) or one.loss > other.loss

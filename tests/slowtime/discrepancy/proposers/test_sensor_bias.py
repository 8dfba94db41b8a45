"""A steady error of an accelerometer is its own, however much else is missing."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.proposers.sensor_bias import (
    biased_accelerometer,
    sensor_bias_candidate,
)
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.search import SearchSettings, search
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.rigs import two_masses

RATE, SAMPLES = 64.0, 1600
NAMES = ("cubic_hardening", "gap_symmetric", "sensor_bias", "sensor_drift", "sensor_gain")
KINDS = {name: kind for name, kind in catalogue().items() if name in NAMES}
RIG = two_masses(3.0)
GROUND = Place("element", RIG.elements[0].id)
OFF = Place("sensor", "a2")
STRONG = Effect("cubic_hardening", GROUND, {"k3_n_per_m3": 4e6})


def recorded(course, effects=(STRONG,), of=RIG):
    """Two records, one sensor of which is off by a course of time from 0 to 1."""
    rng = np.random.default_rng(4)
    plant = Plant.of(
        dataclasses.replace(of, effects=tuple(e.entry() for e in effects)), kinds=KINDS
    )
    trials = []
    for number, level in enumerate((20.0, 40.0)):
        push = level * np.convolve(rng.standard_normal(SAMPLES), np.hanning(9) / 2, "same")
        clean = plant.simulate(plant.values, push[:, None], RATE)
        told = clean + 0.01 * clean.std(axis=0) * rng.standard_normal(clean.shape)
        told[:, -1] += course(number + np.linspace(0.0, 1.0, SAMPLES))
        start_s = number * SAMPLES / RATE
        trials.append(Trial(inputs=push[:, None], outputs=told, rate_hz=RATE, start_s=start_s))
    return tuple(trials)


def fitted(trials, of=RIG):
    return refit(Plant.of(of, kinds=KINDS), trials)


def constant(t):
    return 0.6 + 0.0 * t


def rising(t):
    return 0.5 * t


def wandering(t):
    return 0.8 * np.sin(2.1 * t) + 0.6


@pytest.mark.parametrize("course", [constant, rising, wandering])
def test_a_biased_accelerometer_is_seen_beside_a_law_that_explains_far_more(course):
    trials = recorded(course)
    assert biased_accelerometer(fitted(trials), trials) == OFF


def test_no_accelerometer_is_biased_where_only_a_law_is_missing():
    trials = recorded(lambda t: 0.0 * t)
    assert biased_accelerometer(fitted(trials), trials) is None


@pytest.mark.long
@pytest.mark.parametrize(
    ("course", "told"),
    [(constant, "sensor_bias"), (rising, "sensor_drift"), (wandering, None)],
)
def test_an_accelerometer_is_corrected_where_a_law_of_its_error_explains_it(course, told):
    trials = recorded(course)
    fit = fitted(trials)
    found = sensor_bias_candidate(fit, OFF, locate(fit, trials), trials, KINDS)
    assert (found and found.effect.kind) == told
    if found:
        assert biased_accelerometer(found.fit, trials) is None


def test_sensors_of_displacement_and_structures_that_float_are_not_judged_by_their_mean():
    told = dataclasses.replace(
        RIG,
        sensors=tuple(
            dataclasses.replace(s, quantity="displacement", unit="m") for s in RIG.sensors
        ),
    )
    trials = recorded(lambda t: 0.01 + 0.0 * t, of=told)
    assert biased_accelerometer(fitted(trials, told), trials) is None
    free = dataclasses.replace(RIG, elements=RIG.elements[1:])
    trials = recorded(constant)
    assert biased_accelerometer(fitted(trials, free), trials) is None


@pytest.mark.long
@pytest.mark.parametrize("course", [constant, wandering])
def test_the_law_beside_it_is_found_with_its_numbers(course):
    trials = recorded(course)
    found = search(fitted(trials), trials, SearchSettings(KINDS, Monitor()))
    told = {answer.effect.kind: answer for answer in found.effects}
    assert set(told) == {
        "cubic_hardening", "sensor_bias" if course is constant else "sensor_drift"
    }  # fmt: skip
    k3 = told["cubic_hardening"].numbers["k3_n_per_m3"]
    assert k3.value == pytest.approx(4e6, rel=0.01)

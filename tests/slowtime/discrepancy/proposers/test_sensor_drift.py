"""Sensors whose slow error follows no law drift; a constant error is none."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.proposers.sensor_drift import (
    drifting,
    sensor_drift,
    with_sensor_again,
    without_sensor,
)
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.effects import Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.rigs import two_masses

KINDS = catalogue()
RATE, SAMPLES = 64.0, 1280
RIG = two_masses(1.5)


def walk(rng, _):
    return np.cumsum(rng.standard_normal(SAMPLES)) / np.sqrt(SAMPLES)


def within_each_record(_rng, _):
    return np.linspace(0.0, 1.5, SAMPLES)


def over_the_campaign(_rng, number):
    return np.linspace(0.6 * number, 0.6 * (number + 1), SAMPLES)


def constant(_rng, _):
    return np.full(SAMPLES, 0.7)


def located(course):
    rng, plant = np.random.default_rng(4), Plant.of(RIG, kinds=KINDS)
    trials = []
    for number in range(2):
        push = rng.standard_normal((SAMPLES, 1))
        seen = plant.simulate(plant.values, push, RATE)
        scale = seen.std(axis=0)
        seen = seen + 0.01 * scale * rng.standard_normal(seen.shape)
        seen[:, 1] += scale[1] * course(rng, number)
        start_s = 30.0 * number
        trials.append(Trial(inputs=push, outputs=seen, rate_hz=RATE, start_s=start_s))
    fit = refit(plant, tuple(trials))
    return fit, locate(fit, tuple(trials))


@pytest.mark.long
@pytest.mark.parametrize("course", [walk, within_each_record, over_the_campaign])
def test_a_slow_error_of_a_sensor_is_a_drift(course):
    fit, where = located(course)
    answer = sensor_drift(fit, where, KINDS)
    assert answer is not None
    assert (answer.effect.kind, answer.effect.place) == ("sensor_drift", Place("sensor", "a2"))
    assert answer.numbers["drift_total"].unit == "m/s^2"


def test_a_constant_error_of_a_sensor_is_no_drift():
    fit, where = located(constant)
    assert sensor_drift(fit, where, KINDS) is None


def test_a_sensor_that_was_left_out_gets_its_noise_back_and_no_other_does():
    rng, plant = np.random.default_rng(5), Plant.of(RIG, kinds=KINDS)
    push = rng.standard_normal((SAMPLES, 1))
    seen = plant.simulate(plant.values, push, RATE)
    seen = seen + [0.01, 0.03] * rng.standard_normal(seen.shape)
    trials = (Trial(inputs=push, outputs=seen, rate_hz=RATE),)
    before = refit(plant, trials)
    deaf = without_sensor(before, trials, "a2")
    assert deaf[0].used[:, 0].all()
    assert not deaf[0].used[:, 1].any()
    fit = refit(plant, deaf)
    again = with_sensor_again(fit, before, "a2")
    assert fit.noise.sd(0, RATE)[1] > 100 * before.noise.sd(0, RATE)[1]
    assert again.noise.colours[0] == (fit.noise.colours[0][0], before.noise.colours[0][1])
    assert again.noise.relative_sd[0][1] == before.noise.relative_sd[0][1]


@pytest.mark.parametrize("starts_s", [(0.0, 30.0, 90.0), (0.0, 90.0, 0.0)])
def test_a_steady_drift_is_quoted_over_the_campaign(starts_s):
    """Also where a record does not say when it began: it rises as fast there."""
    rng, plant = np.random.default_rng(4), Plant.of(RIG, kinds=KINDS)
    trials = []
    for begin_s, start_s in zip((0.0, 30.0, 90.0), starts_s, strict=True):
        push = rng.standard_normal((SAMPLES, 1))
        seen = plant.simulate(plant.values, push, RATE)
        seen = seen + 0.01 * seen.std(axis=0) * rng.standard_normal(seen.shape)
        seen[:, 1] += 0.02 * (begin_s + np.arange(SAMPLES) / RATE)
        trials.append(Trial(inputs=push, outputs=seen, rate_hz=RATE, start_s=start_s))
    answer = drifting(refit(plant, tuple(trials)), tuple(trials), Place("sensor", "a2"), KINDS)
    total, span = answer.numbers["drift_total"], answer.numbers["span_s"]
    assert span.value == max(starts_s) + SAMPLES / RATE
    assert abs(total.value / span.value - 0.02) < 2 * total.sd / span.value
    assert total.sd < 0.3 * total.value


def test_a_random_drift_is_quoted_over_a_record():
    fit, where = located(walk)
    numbers = drifting(fit, where.trials, Place("sensor", "a2"), KINDS).numbers
    assert set(numbers) == {"drift_total"}
    assert numbers["drift_total"].sd > 0.1 * abs(numbers["drift_total"].value)


def test_the_drift_of_one_record_is_quoted_over_that_record():
    fit, where = located(over_the_campaign)
    trials = (dataclasses.replace(where.trials[1], start_s=1000.0),)
    one = dataclasses.replace(fit, residual=fit.residual[1:])
    numbers = drifting(one, trials, Place("sensor", "a2"), KINDS).numbers
    both = drifting(fit, where.trials, Place("sensor", "a2"), KINDS).numbers
    assert set(numbers) == {"drift_total"}
    rate = both["drift_total"].value / both["span_s"].value
    assert numbers["drift_total"].value == pytest.approx(rate * SAMPLES / RATE, rel=0.05)

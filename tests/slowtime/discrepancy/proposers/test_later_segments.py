"""Where two strong effects are missing, the second is seen in the first part of the records."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import WRONG_MODEL_CHI2, refit
from slowtime.discrepancy.calibration.augmentation import with_effect
from slowtime.discrepancy.candidates.library_fit import label_of
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.proposers.later_segments import (
    RECORD_SHARES,
    later_segment_candidates,
)
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.search import SearchSettings, search
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import in_budget
from tests.slowtime.discrepancy.rigs import ONE, PLACE

NAMES = ("cubic_hardening", "sensor_clock", "sensor_gain", "viscous_damping", "stiffness_jump")
KINDS = {name: kind for name, kind in catalogue().items() if name in NAMES}
RATE = 64.0
ACCELERATION = dataclasses.replace(
    ONE,
    sensors=(dataclasses.replace(ONE.sensors[0], quantity="acceleration", unit="m/s^2"),),
)
LAW = Effect("cubic_hardening", PLACE, {"k3_n_per_m3": 1e5})
CLOCK = Effect("sensor_clock", Place("sensor", "x"), {"skew": -3e-3})


@pytest.fixture(scope="module")
def records():
    """One mass on a spring that hardens much, by a clock that is slow."""
    rng = np.random.default_rng(2)
    entries = (LAW.entry(), CLOCK.entry())
    truth = Plant.of(dataclasses.replace(ACCELERATION, effects=entries), kinds=KINDS)
    trials = []
    for level in (10.0, 20.0):
        push = level * np.convolve(rng.standard_normal(2400), np.hanning(7) / 2, "same")
        clean = truth.simulate(truth.values, push[:, None], RATE)
        noise = 0.02 * clean.std(axis=0) * rng.standard_normal(clean.shape)
        trials.append(Trial(inputs=push[:, None], outputs=clean + noise, rate_hz=RATE))
    return tuple(trials)


@pytest.mark.long
def test_laws_are_looked_for_in_the_first_part_of_which_the_model_leaves_something(records):
    plant = Plant.of(with_effect(ACCELERATION, LAW), kinds=KINDS)
    before = refit(plant, records)
    assert before.chi2_in_band > 100.0
    part, tried = later_segment_candidates(before, records, KINDS, in_budget)
    assert WRONG_MODEL_CHI2 < part.chi2_in_band < before.chi2_in_band
    longest = max(RECORD_SHARES) * len(records[0].outputs)
    assert all(len(residual) <= longest for residual in part.residual)
    assert label_of(tried[0].effect) == label_of(CLOCK)
    assert tried[0].cost < tried[1].cost / 2
    assert all(one.start is None for one in tried)
    costs = [one.cost for one in tried]
    assert costs == sorted(costs)


def test_a_model_that_explains_half_of_the_records_lacks_nothing_there(records):
    both = with_effect(with_effect(ACCELERATION, LAW), CLOCK)
    fit = refit(Plant.of(both, kinds=KINDS), records)
    assert fit.chi2_in_band < 1.2
    assert later_segment_candidates(fit, records, KINDS, in_budget)[1] == []


def test_out_of_budget_nothing_is_proposed(records):
    before = refit(Plant.of(ACCELERATION, kinds=KINDS), records)
    assert later_segment_candidates(before, records, KINDS, lambda: True)[1] == []


@pytest.mark.long
def test_a_strong_law_and_a_slow_clock_are_both_named(records):
    first = refit(Plant.of(ACCELERATION, kinds=KINDS), records)
    found = search(first, records, SearchSettings(KINDS, Monitor()))
    told = {answer.effect.kind: answer.numbers for answer in found.effects}
    assert set(told) == {"cubic_hardening", "sensor_clock"}
    assert told["sensor_clock"]["skew"].value == pytest.approx(-3e-3, rel=0.01)
    assert told["cubic_hardening"]["k3_n_per_m3"].value == pytest.approx(1e5, rel=0.01)
    assert found.last.chi2_in_band < 1.2

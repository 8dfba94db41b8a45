"""When a gap is called a disagreement, and how often that is by chance."""

import json
from typing import Any

import numpy as np
import pytest

from slowtime_services.simulate import simulated_structure
from twin_server.diagnose.gap import IN_A_ROW, learn, limit_factor, measure
from twin_server.diagnose.samples import pieces_of


@pytest.mark.parametrize(("count", "between"), [(8, 200.0), (30, 500.0)])
def test_two_in_a_row_beyond_the_limit_are_as_rare_as_stated(count, between):
    rng = np.random.default_rng(3)
    runs = 200_000
    learnt = rng.standard_normal((runs, count))
    limit = learnt.mean(axis=1) + limit_factor(count, between) * learnt.std(axis=1, ddof=1)
    beyond = (rng.standard_normal((runs, IN_A_ROW)) > limit[:, None]).all(axis=1)
    expected = runs / between
    assert abs(beyond.sum() - expected) < 5.0 * np.sqrt(expected)


def test_what_is_usual_is_the_typical_gap_and_its_scatter():
    rng = np.random.default_rng(0)
    gaps = 0.03 * np.exp(0.1 * rng.standard_normal(200))
    usual = learn([(gap, 5.0) for gap in gaps], 1e5)
    assert usual.expected == pytest.approx(0.03, rel=0.03)
    assert 0.03 * np.exp(0.25) < usual.limit < 0.03 * np.exp(0.4)
    assert usual.level == pytest.approx(5.0)
    assert usual.readings == 200


def test_a_weaker_record_may_be_further_off_for_its_noise_weighs_more():
    usual = learn([(0.03, 5.0), (0.031, 5.0)] * 5, 1e5)
    assert usual.limit_at(2.5) == pytest.approx(2 * usual.limit)
    assert usual.limit_at(50.0) == usual.limit


def test_a_scatter_of_nothing_does_not_make_every_reading_a_disagreement():
    usual = learn([(0.03, 1.0)] * 10, 1e5)
    assert usual.limit > 1.05 * usual.expected


MODEL: dict[str, Any] = {
    "slowtime_model": 1,
    "nodes": [{"id": "m1", "mass_kg": 2.0}],
    "elements": [
        {
            "id": "j1", "between": ["base", "m1"],
            "stiffness_n_per_m": 4000.0, "damping_n_s_per_m": 2.0,
        }
    ],
    "inputs": [{"channel": "u", "kind": "force", "node": "m1", "unit": "N"}],
    "sensors": [
        {"channel": "a1", "quantity": "acceleration", "node": "m1", "unit": "m/s^2"}
    ],
    "tolerance": {"stiffness": 0.02, "damping": 0.1},
}  # fmt: skip
FRICTION = {"effect": "coulomb", "element": "j1", "friction_n": 0.6}


def record(effects=()):
    """A record of the rig on a warm day, 1 % softer than its model."""
    structure = simulated_structure(
        {
            "kind": "model", "model": MODEL, "effects": effects, "seconds": 10.0,
            "rate_hz": 100.0, "input_rms": 3.0, "band_hz": (0.5, 20.0),
            "sensor": {"noise": 0.02},
            "stiffness": {"j1": {"kind": "constant", "change": -0.01}},
        }
    )  # fmt: skip
    return pieces_of(structure.epoch(0))[0].record


def test_a_constant_within_tolerance_is_no_gap_where_constants_are_fitted_to_each_record():
    model = json.dumps(MODEL)
    (as_given,) = measure([model], record(), False).gaps
    (refitted,) = measure([model], record(), True).gaps
    assert as_given > 0.06
    assert refitted == pytest.approx(0.02, rel=0.15)


def test_what_is_missing_stays_a_gap_and_an_adopted_effect_is_not_fitted_away():
    models = [json.dumps(MODEL), json.dumps(MODEL | {"effects": [FRICTION]})]
    without, with_friction = measure(models, record([FRICTION]), True).gaps
    assert without > 3 * with_friction
    softer = [MODEL["elements"][0] | {"stiffness_n_per_m": 0.99 * 4000.0}]
    true = json.dumps(MODEL | {"elements": softer, "effects": [FRICTION]})
    assert measure([true], record([FRICTION]), False).gaps == pytest.approx(
        [with_friction], rel=0.05
    )
    gone_without, gone_with = measure(models, record(), True).gaps
    assert gone_with > 3 * gone_without

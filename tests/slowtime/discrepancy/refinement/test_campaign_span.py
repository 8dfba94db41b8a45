"""Drifts are quoted over the whole campaign, records held out included."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.refinement.campaign_span import span_campaign, spanning
from slowtime.discrepancy.selection.probabilities import answer_of
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.rigs import ONE, PLACE

KINDS = catalogue()
RATE = 64.0
LOSS = Effect("stiffness_drift", PLACE, {"dk_n_per_m": 60.0, "span_s": 40.0})


@pytest.fixture(scope="module")
def drifting():
    """Three records of a spring that softens over forty seconds; the last is held out."""
    rng = np.random.default_rng(5)
    truth = Plant.of(dataclasses.replace(ONE, effects=(LOSS.entry(),)), kinds=KINDS)
    trials = []
    for start_s in (0.0, 10.0, 30.0):
        push = 5.0 * rng.standard_normal((640, 1))
        clean = truth.simulate(truth.values, push, RATE, start_s=start_s)
        noise = 0.01 * clean.std(axis=0) * rng.standard_normal(clean.shape)
        trials.append(Trial(inputs=push, outputs=clean + noise, rate_hz=RATE, start_s=start_s))
    learnt = tuple(trials[:2])
    effect = Effect("stiffness_drift", PLACE, {"dk_n_per_m": 20.0, "span_s": 20.0})
    plant = Plant.of(dataclasses.replace(ONE, effects=(effect.entry(),)), kinds=KINDS)
    fit = refit(plant, learnt, horizons=(1.0,))
    campaign = Campaign(description=ONE, trials=learnt, holdout=(trials[2],))
    return fit, campaign, FittedCandidate(effect, plant.description, fit, 0.0)


def test_a_drift_over_a_longer_span_has_the_same_slope_and_the_same_run(drifting):
    fit, campaign, _ = drifting
    longer = spanning(fit, 0, 40.0)
    names = list(fit.plant.parameters)
    slope = [
        one.values[names.index(("effect", 0, "dk_n_per_m"))]
        / one.values[names.index(("effect", 0, "span_s"))]
        for one in (fit, longer)
    ]
    assert slope[1] == pytest.approx(slope[0], rel=1e-12)
    trial = campaign.holdout[0]
    runs = [
        one.plant.simulate(one.values, trial.inputs, RATE, start_s=trial.start_s)
        for one in (fit, longer)
    ]
    np.testing.assert_allclose(runs[1], runs[0], rtol=0, atol=1e-9 * runs[0].std())
    at = fit.prior.names.index(("effect", 0, "dk_n_per_m"))
    assert longer.sd[at] / longer.free[at] == pytest.approx(fit.sd[at] / fit.free[at])


def test_a_drift_is_quoted_by_its_value_at_the_end_of_all_records(drifting):
    fit, campaign, named = drifting
    effects = (answer_of([named], [1.0], KINDS),)
    found = Hypothesis((fit, fit), campaign.trials, effects=effects)
    found = span_campaign(found, 0, campaign, KINDS)
    number = found.effects[0].numbers["dk_n_per_m"]
    assert found.effects[0].effect.parameters["span_s"] == 40.0
    assert abs(number.value - 60.0) < 3 * number.sd < 6.0
    assert "60" in found.effects[0].sentence or "59" in found.effects[0].sentence


def test_a_drift_that_the_model_was_given_keeps_its_span(drifting):
    fit, *_ = drifting
    assert np.array_equal(spanning(fit, 1, 40.0).values, fit.values)

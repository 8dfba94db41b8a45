"""The forecast of a twin: right as often as it says, wide where the nominal is uncertain."""

import numpy as np
import pytest

from twin_server.estimate import (
    Checkpoint,
    Twin,
    estimate,
    forecast_changes,
    learn,
    past_of,
    past_of_elements,
)
from twin_server.estimate.checkpoint import NominalInUse
from twin_server.registration.thresholds import Limit
from twin_server.registration.twin import Registration

NOMINAL = {"frequency_hz": 3.0, "damping_ratio": 0.02}


def history(features, **registration):
    made = Registration(**registration)
    twin = Twin(made, Checkpoint.start(made))
    found = estimate([twin], features, [0] * len(features), [0] * len(features))
    return found.states, found.checkpoints[0].known


def ahead_of(states, known, horizon, count, outlooks=None, thresholds=()):
    past = past_of(states, known)
    found = forecast_changes(past, outlooks or learn(past), horizon, count, thresholds)
    assert found is not None
    return found


@pytest.mark.long
def test_the_band_holds_what_comes(ageing):
    held = []
    for seed in range(8):
        states, known = history(ageing(120, seed=seed), nominal=NOMINAL)
        ahead = ahead_of(states[:100], known, 19.0, 19)
        truth = states["truth"][100:119, 2]
        band = ahead.bands["stiffness_change"]
        held += ((band[:, 2] <= truth) & (truth <= band[:, 3])).tolist()
        np.testing.assert_allclose(ahead.slow_time, np.arange(100.0, 119.0))
        assert ahead.since == 99.0
    assert np.mean(held) > 0.85


def test_only_what_is_estimated_is_forecast(ageing):
    states, known = history(ageing(40), changes="mass", nominal=NOMINAL)
    assert set(ahead_of(states, known, None, 5).bands) == {"mass_change"}
    states, known = history(
        ageing(40), changes="both", nominal=NOMINAL, damping_coefficient_sd=0.0
    )
    assert set(ahead_of(states, known, None, 5).bands) == {"mass_change", "stiffness_change"}


def test_too_few_readings_give_no_forecast(ageing):
    states, known = history(ageing(9), nominal=NOMINAL)
    assert forecast_changes(past_of(states, known), {}, 1.0, 2) is None
    assert forecast_changes(past_of(states[:0], known), {}, 1.0, 2) is None


def test_a_nominal_in_doubt_is_not_averaged_away(ageing):
    doubtful = {**NOMINAL, "frequency_relative_sd": 0.01}
    states, known = history(ageing(300, loss=0.0), nominal=doubtful)
    band = ahead_of(states, known, 1.0, 1).bands["stiffness_change"]
    assert band[0, 1] == pytest.approx(0.02, rel=0.1)
    states, known = history(ageing(300, loss=0.0), nominal=NOMINAL)
    assert ahead_of(states, known, 1.0, 1).bands["stiffness_change"][0, 1] < 0.001


def test_beyond_its_horizon_it_says_so(ageing):
    states, known = history(ageing(60), nominal=NOMINAL)
    far = ahead_of(states, known, 1e5, 3)
    assert far.until < 1e5
    assert "the readings contain little information" in far.reasons[0]
    near = ahead_of(states, known, (far.until - far.since) / 2, 3)
    assert near.reasons == ()


def test_what_was_learnt_once_serves_again(ageing):
    states, known = history(ageing(60), nominal=NOMINAL)
    first = ahead_of(states, known, 5.0, 3)
    again = ahead_of(states, known, 5.0, 3, first.outlooks)
    of_both = [one.outlooks["stiffness_change"].outlook for one in (again, first)]
    assert of_both[0] is of_both[1]
    np.testing.assert_array_equal(
        again.bands["stiffness_change"], first.bands["stiffness_change"]
    )


def test_the_time_to_a_threshold_is_a_distribution_that_holds_when_it_comes(ageing):
    held, asked = [], Limit("stiffness_change", -0.15, "below")
    for seed in range(3):
        states, known = history(ageing(120, seed=seed), nominal=NOMINAL)
        ahead = ahead_of(states[:60], known, 60.0, 2, thresholds=[asked])
        ((_, told),) = ahead.crossings
        true = states["slow_time"][np.argmax(states["truth"][:, 2] <= -0.15)]
        held.append(told.slow_time[0] - 1.0 <= true <= told.slow_time[2] + 1.0)
        assert told.shares == (0.1, 0.5, 0.9)
        assert told.already == 0.0
    assert sum(held) >= 2


def test_a_threshold_may_be_passed_already_or_never_within_the_horizon(ageing):
    states, known = history(ageing(60), nominal=NOMINAL)
    limits = [Limit("stiffness_change", at, "below") for at in (-0.01, -0.9)]
    passed, never = (
        told for _, told in ahead_of(states, known, 30.0, 2, thresholds=limits).crossings
    )
    assert passed.already > 0.99
    assert passed.slow_time[2] == 59.0
    assert np.isinf(never.slow_time).all()
    assert never.horizon == 89.0
    none = ahead_of(states, known, 30.0, 2, thresholds=[Limit("mass_change", 0.1)])
    assert none.crossings == ()


def test_a_nominal_in_doubt_makes_the_time_to_a_threshold_uncertain(ageing):
    widths = []
    for doubt in (0.0, 0.01):
        nominal = {**NOMINAL, "frequency_relative_sd": doubt}
        states, known = history(ageing(60), nominal=nominal)
        limit = [Limit("stiffness_change", -0.3, "below")]
        ((_, told),) = ahead_of(states, known, 200.0, 2, thresholds=limit).crossings
        widths.append(min(told.slow_time[2], 259.0) - told.slow_time[0])
    assert widths[1] > 2 * widths[0]


def test_a_twin_that_is_still_learning_has_no_forecast(ageing):
    states, known = history(ageing(12), learn_epochs=50)
    assert known is None
    assert (
        forecast_changes(past_of(states, NominalInUse(3.0, 0.0, 0.02, 0.0)), {}, 1.0, 2) is None
    )


@pytest.fixture(scope="module")
def weakening(frame):
    """A frame whose second storey loses 0.2 % of its stiffness an epoch from epoch 20 on."""
    made = frame(seed=9)
    loss = [(0.0, -0.002 * max(0, i - 20), 0.0) for i in range(70)]
    features = [made.epoch(i, changes) for i, changes in enumerate(loss)]
    twin = Registration(**made.registration())
    start = Twin(twin, Checkpoint.start(twin))
    found = estimate([start], features, [0] * 70, [0] * 70)
    return found, np.array(loss)


@pytest.mark.long
def test_each_element_is_forecast(weakening):
    found, loss = weakening
    bodies = [detail.body for detail in found.details]
    memory = found.checkpoints[0].elements
    past = past_of_elements(found.states[:60], bodies[:60], memory)
    ahead = forecast_changes(past, learn(past), 9.0, 9)
    assert ahead is not None
    assert list(ahead.bands) == ["storey1", "storey2", "storey3"]
    np.testing.assert_allclose(ahead.slow_time, np.arange(60.0, 69.0))
    for number, band in enumerate(ahead.bands.values()):
        true = loss[60:69, number]
        assert ((band[:, 2] <= true) & (true <= band[:, 3])).mean() > 0.85
        assert (band[:, 1] > 0.0).all()
    assert ahead.bands["storey2"][-1, 0] < ahead.bands["storey2"][0, 0] - 0.01


@pytest.mark.long
def test_what_was_learnt_of_elements_is_not_averaged_away(weakening):
    found, _ = weakening
    bodies = [detail.body for detail in found.details]
    memory = found.checkpoints[0].elements
    assert memory.common_share == pytest.approx(1 / 21)
    past = past_of_elements(found.states, bodies, memory)["storey1"]
    ahead = forecast_changes({"storey1": past}, learn({"storey1": past}), 1.0, 1)
    assert ahead is not None
    assert ahead.bands["storey1"][0, 1] >= past.common * 0.99
    assert past.common == pytest.approx(np.median(past.sd) / np.sqrt(21), rel=0.1)


@pytest.mark.long
def test_a_twin_of_elements_that_is_still_learning_has_no_forecast(weakening):
    found, _ = weakening
    bodies = [detail.body for detail in found.details]
    memory = found.checkpoints[0].elements
    past = past_of_elements(found.states[:20], bodies[:20], memory)
    assert forecast_changes(past, learn(past), 1.0, 2) is None
    assert past_of_elements(found.states, (), memory) == {}

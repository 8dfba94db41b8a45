"""The forecast of a twin: right as often as it says, wide where the nominal is uncertain."""

import numpy as np
import pytest

from twin_server.estimate import Checkpoint, Twin, estimate, foresee
from twin_server.estimate.checkpoint import Known
from twin_server.registration import Registration

NOMINAL = {"frequency_hz": 3.0, "damping_ratio": 0.02}


def history(features, **registration):
    made = Registration(**registration)
    twin = Twin(made, Checkpoint.start(made))
    found = estimate([twin], features, [0] * len(features), [0] * len(features))
    return found.states, found.checkpoints[0].known


def ahead_of(*arguments):
    found = foresee(*arguments)
    assert found is not None
    return found


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
    assert foresee(states, known, 1.0, 2) is None
    assert foresee(states[:0], known, 1.0, 2) is None


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
    assert "the readings say little" in far.reasons[0]
    near = ahead_of(states, known, (far.until - far.since) / 2, 3)
    assert near.reasons == ()


def test_what_was_learnt_once_serves_again(ageing):
    states, known = history(ageing(60), nominal=NOMINAL)
    first = ahead_of(states, known, 5.0, 3)
    again = ahead_of(states, known, 5.0, 3, first.outlooks)
    assert again.outlooks["stiffness_change"] is first.outlooks["stiffness_change"]
    np.testing.assert_array_equal(
        again.bands["stiffness_change"], first.bands["stiffness_change"]
    )


def test_a_twin_that_is_still_learning_has_no_forecast(ageing):
    states, known = history(ageing(12), learn_epochs=50)
    assert known is None
    assert foresee(states, Known(3.0, 0.0, 0.02, 0.0), 1.0, 2) is None

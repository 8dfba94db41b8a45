"""What is kept of a past: a reading more is one step, and leads where all of them lead."""

import numpy as np
import pytest

from slowtime.evolution.forecasting import continuation, forecast
from tests.slowtime.evolution.life.crossings import draw_futures, first_crossing


@pytest.fixture(scope="module", params=["smooth", "repeating"])
def learnt(request):
    rng = np.random.default_rng(81)
    time = np.cumsum(rng.uniform(0.5, 1.5, 140))
    value = 0.05 * np.sin(2 * np.pi * time / 17.0) - 1e-3 * time + 0.08 * (time > 70.0)
    sd = rng.uniform(0.005, 0.015, 140)
    value = value + sd * rng.standard_normal(140)
    first = time[:100], value[:100], sd[:100]
    return forecast.fit(*first, process=request.param), (time, value, sd)


def cut(history, begin, end):
    return tuple(x[begin:end] for x in history)


def test_one_after_the_other_or_all_together_to_the_last_bit(learnt):
    outlook, history = learnt
    later = history[0][-1] + np.array([1.0, 20.0, 60.0])
    whole = continuation.begin(outlook, *history).predict(later)
    for step in (1, 7, 40):
        begun = continuation.begin(outlook, *cut(history, 0, 100))
        for at in range(100, 140, step):
            begun = begun.follow(*cut(history, at, min(at + step, 140)))
        found = begun.predict(later)
        for name in ("mean", "sd", "lo", "hi", "horizon"):
            np.testing.assert_array_equal(getattr(found, name), getattr(whole, name))
    time, value, sd = history
    again = forecast.predict(outlook, time, value, sd, later)
    np.testing.assert_array_equal(again.mean, whole.mean)


def test_what_is_kept_does_not_grow(learnt):
    outlook, history = learnt
    begun = continuation.begin(outlook, *cut(history, 0, 100))
    after = begun.follow(*cut(history, 100, 140))
    assert after.smooth.mean.shape == begun.smooth.mean.shape
    assert after.time == history[0][-1]


def test_readings_of_an_earlier_time_are_refused_and_those_of_none_passed_over(learnt):
    outlook, history = learnt
    begun = continuation.begin(outlook, *cut(history, 0, 100))
    with pytest.raises(ValueError, match="Begin anew from all readings in order"):
        begun.follow(*cut(history, 50, 60))
    bad = np.array([np.nan]), np.array([0.1]), np.array([0.1])
    assert begun.follow(*bad) is begun


def test_all_thresholds_are_told_by_the_same_futures(learnt):
    outlook, history = learnt
    time, value, sd = history
    horizon = float(time[-1] + 60.0)
    futures = draw_futures(continuation.begin(outlook, time, value, sd), horizon, paths=500)
    for threshold in (-0.2, 0.0):
        alone = first_crossing(outlook, time, value, sd, threshold, horizon, paths=500)
        together = futures.crossing(threshold)
        np.testing.assert_array_equal(together.slow_time, alone.slow_time)
        assert together.within == alone.within

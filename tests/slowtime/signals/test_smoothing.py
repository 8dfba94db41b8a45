import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slowtime.signals.filters import ewma, median
from slowtime.signals.smoothing import MedianEwma, median_penalty


def run(smoother: MedianEwma, values, sds):
    state, out = smoother.start(), []
    for value, sd in zip(values, sds, strict=True):
        state, smooth = smoother.step(state, float(value), float(sd))
        out.append(smooth)
    return out


@given(
    values=st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=40),
    window=st.sampled_from([1, 3, 5, 9]),
    a=st.floats(0.05, 1.0),
)
@settings(deadline=None)
def test_the_stream_equals_the_two_filters_one_after_the_other(values, window, a):
    x = np.array(values)
    streamed = [smooth.value for smooth in run(MedianEwma(window=window, a=a), x, 0 * x)]
    np.testing.assert_allclose(streamed, ewma(median(x, window), a), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("window", "a"), [(1, 0.3), (5, 0.3), (9, 0.1), (3, 1.0)])
def test_a_ramp_is_seen_late_by_the_stated_lag(window, a):
    ramp = np.arange(400.0)
    last = run(MedianEwma(window=window, a=a), ramp, 0 * ramp)[-1]
    assert ramp[-1] - last.value == pytest.approx(last.lag, rel=1e-3)
    assert last.lag == pytest.approx(MedianEwma(window=window, a=a).lag, rel=1e-3)


@pytest.mark.long
@pytest.mark.parametrize("length", [1, 2, 4, 30])
def test_the_stated_sd_is_that_of_the_noise_left(length):
    rng = np.random.default_rng(3)
    smoother = MedianEwma(window=5, a=0.3)
    sds = np.linspace(1.0, 2.0, length)
    last = [run(smoother, sds * rng.standard_normal(length), sds)[-1] for _ in range(1200)]
    scatter = np.std([smooth.value for smooth in last])
    assert 0.9 <= scatter / last[0].sd <= 1.04


def test_one_outlier_does_not_move_it():
    steady = [5.0] * 12
    spoilt = steady.copy()
    spoilt[6] = 50.0
    smoother = MedianEwma()
    for calm, hit in zip(
        run(smoother, steady, [0.1] * 12), run(smoother, spoilt, [0.1] * 12), strict=True
    ):
        assert calm.value == hit.value


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 6, 7, 8, 9, 15, 20])
def test_the_penalty_of_the_median_is_what_order_statistics_say(count):
    draws = np.random.default_rng(5).standard_normal((200_000, count))
    assert median_penalty(count) == pytest.approx(
        np.median(draws, axis=1).var() * count, rel=0.015
    )


@pytest.mark.parametrize("reading", [(np.nan, 0.1), (1.0, -0.1), (1.0, np.inf)])
def test_a_reading_that_is_none_is_refused(reading):
    with pytest.raises(ValueError, match="leave a missing reading out"):
        MedianEwma().step(MedianEwma().start(), *reading)

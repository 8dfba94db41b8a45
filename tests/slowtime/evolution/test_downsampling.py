import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slowtime.evolution import extremes


@given(st.integers(2, 3_000), st.integers(2, 300), st.integers(0, 2**32 - 1))
def test_no_extreme_is_hidden_and_no_more_than_asked_is_kept(count, most, seed):
    rng = np.random.default_rng(seed)
    value = rng.standard_normal(count)
    lo, hi = value - rng.exponential(size=count), value + rng.exponential(size=count)
    kept = extremes(value, most, lo=lo, hi=hi)
    assert len(kept) <= max(most, 2)
    assert (np.diff(kept) > 0).all()
    assert kept[0] == 0
    assert kept[-1] == count - 1
    if most >= 6:
        assert {value.argmin(), value.argmax(), lo.argmin(), hi.argmax()} <= set(kept)
    if count <= most:
        assert len(kept) == count


def test_a_spike_in_every_part_of_the_history_is_kept():
    value = np.zeros(10_000)
    spikes = np.arange(57, 10_000, 500)
    value[spikes] = -1.0
    assert set(spikes) <= set(extremes(value, 200))


def test_missing_values_hide_nothing():
    value = np.full(1_000, np.nan)
    value[[10, 500, 501]] = [1.0, -9.0, 9.0]
    assert {500, 501} <= set(extremes(value, 20))
    np.testing.assert_array_equal(extremes(np.full(100, np.nan), 10), [0, 99])


def test_an_infinite_end_of_an_interval_is_an_extreme_too():
    value = np.zeros(100)
    hi = np.ones(100)
    hi[37] = np.inf
    assert 37 in extremes(value, 10, lo=value, hi=hi)


def test_less_than_two_points_is_refused():
    with pytest.raises(ValueError, match="Give 2 or more"):
        extremes(np.zeros(5), 1)

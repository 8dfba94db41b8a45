import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slowtime.signals.clock.sampling_clock import ClockTolerances, SamplingClock
from tests.slowtime.signals.clock.latencies import Messages, messages

CLOCK = SamplingClock(nominal_rate_hz=200.0)
SOME = messages(np.random.default_rng(5), Messages(seconds=90.0))


def read(clock, came):
    """What a clock says of all messages."""
    return clock.read(clock.step(clock.start(), came.index, came.arrival_ns))


@given(where=st.sets(st.integers(1, len(SOME.index) - 1), max_size=9))
@settings(deadline=None, max_examples=4)
def test_cutting_the_messages_anywhere_changes_nothing(where):
    state = CLOCK.start()
    cuts = [0, *sorted(where), len(SOME.index)]
    for first, last in itertools.pairwise(cuts):
        state = CLOCK.step(state, SOME.index[first:last], SOME.arrival_ns[first:last])
    whole = CLOCK.step(CLOCK.start(), SOME.index, SOME.arrival_ns)
    assert state == whole
    assert CLOCK.read(state) == CLOCK.read(whole)


def test_before_anything_is_measured_the_assumed_tolerance_is_told():
    reading = CLOCK.read(CLOCK.start())
    assert (reading.correction, reading.flags) == (0.0, ("few",))
    assert reading.correction_sd == pytest.approx(CLOCK.tolerances.rate)


@pytest.mark.parametrize(
    "correction", [0.01, *(pytest.param(c, marks=pytest.mark.long) for c in (-0.01, 1e-4))]
)
def test_the_rate_is_found_within_its_own_interval(correction):
    came = messages(np.random.default_rng(1), Messages(correction=correction))
    reading = read(CLOCK, came)
    assert abs(reading.correction - correction) < 3.5 * reading.correction_sd
    assert reading.correction_sd < 5e-6


@pytest.mark.parametrize("stalls", [pytest.param(0, marks=pytest.mark.long), 6])
def test_stalls_of_seconds_do_not_move_the_time_axis(stalls):
    came = messages(np.random.default_rng(2), Messages(seconds=120.0, stalls=stalls))
    reading = read(CLOCK, came)
    error_s = (reading.time_ns(int(came.index[-1])) - int(came.true_ns[-1])) / 1e9
    assert abs(error_s) < 3 * reading.time_sd_s < 0.03


@pytest.mark.parametrize(
    "step_s", [0.5, *(pytest.param(s, marks=pytest.mark.long) for s in (-0.5, 30.0))]
)
def test_a_step_of_the_hosts_clock_is_noticed_once_and_leaves_the_rate(step_s):
    came = messages(np.random.default_rng(1), Messages(seconds=150.0, step_s=step_s))
    reading = read(CLOCK, came)
    assert (reading.steps, reading.rate_changes) == (1, 0)
    assert "stepped" in reading.flags
    assert abs(reading.correction - 0.01) < 3.5 * reading.correction_sd < 4e-4
    error_s = (reading.time_ns(int(came.index[-1])) - int(came.true_ns[-1])) / 1e9
    assert error_s == pytest.approx(step_s, abs=0.05)


def test_a_rate_that_jumps_is_noticed_and_estimated_anew():
    came = messages(np.random.default_rng(1), Messages(seconds=300.0, jump=1e-3))
    reading = read(CLOCK, came)
    assert reading.rate_changes >= 1
    assert "rate_changed" in reading.flags
    assert abs(reading.correction - 0.011) < 4 * reading.correction_sd < 4e-4


def test_messages_whose_index_does_not_rise_are_left_out_and_counted():
    twice = np.repeat(SOME.index, 2), np.repeat(SOME.arrival_ns, 2)
    reading = CLOCK.read(CLOCK.step(CLOCK.start(), *twice))
    assert (reading.messages, reading.ignored) == (len(SOME.index), len(SOME.index))
    assert reading.correction == read(CLOCK, SOME).correction


def test_a_rate_outside_of_the_tolerance_is_told_and_flagged():
    vouched = SamplingClock(nominal_rate_hz=200.0, tolerances=ClockTolerances(rate=1e-5))
    reading = read(vouched, SOME)
    assert "beyond_tolerance" in reading.flags
    assert abs(reading.correction - 0.01) < 4 * reading.correction_sd


def test_stamps_wrong_to_both_sides_are_averaged():
    rng = np.random.default_rng(6)
    stamps = SOME.true_ns + np.round(rng.normal(0.0, 2e7, len(SOME.true_ns))).astype(np.int64)
    clock = SamplingClock(nominal_rate_hz=200.0, stamps="device")
    reading = clock.read(clock.step(clock.start(), SOME.index, stamps))
    assert abs(reading.correction - 0.01) < 3.5 * reading.correction_sd < 3e-4
    error_s = (reading.time_ns(int(SOME.index[-1])) - int(SOME.true_ns[-1])) / 1e9
    assert abs(error_s) < 0.005


def test_memory_is_bounded_however_long_a_stream_runs():
    index = np.arange(1, 2_001) * 1_600
    state = CLOCK.step(CLOCK.start(), index, np.round(index * 1e9 / 201.0).astype(np.int64))
    assert len(state.history) <= CLOCK.tolerances.spans + 1
    assert max(len(span.hull) for span in state.history) <= 16


def test_what_is_given_is_left_as_it_was():
    index, arrival = SOME.index.copy(), SOME.arrival_ns.copy()
    read(CLOCK, SOME)
    np.testing.assert_array_equal(index, SOME.index)
    np.testing.assert_array_equal(arrival, SOME.arrival_ns)


def test_unequal_numbers_of_indices_and_times_are_refused():
    with pytest.raises(ValueError, match=r"2 indices and 3 arrival times. Give one of each"):
        CLOCK.step(CLOCK.start(), np.arange(2), np.arange(3))


CLASSES = {
    "exponential": Messages(jitter="exponential"),
    "uniform": Messages(jitter="uniform", correction=-3e-3),
    "gamma": Messages(jitter="gamma", correction=1e-3),
    "bimodal": Messages(jitter="bimodal", correction=1e-4),
    "single": Messages(burst=1, correction=-1e-2),
    "short": Messages(seconds=45.0),
    "stepped": Messages(step_s=0.4),
}

CHANGES = {
    "small step": Messages(step_s=0.02, seconds=150.0),
    "step back": Messages(step_s=-0.1, jitter="gamma", seconds=150.0),
    "jump": Messages(jump=1e-3, jitter="gamma", seconds=150.0),
}
"""Changes about as large as what 150 s can show of them."""


def distances(seeds, classes=CLASSES, longest_s=120.0):
    """Errors over their standard deviations, by class."""
    return {
        name: np.array([_distance(seed, given, longest_s) for seed in seeds])
        for name, given in classes.items()
    }


def _distance(seed, given, longest_s):
    seconds = min(given.seconds, longest_s)
    short = dataclasses.replace(given, seconds=seconds, per_message=20)
    reading = read(CLOCK, messages(np.random.default_rng([seed, 7]), short))
    now = 1 / (1 / (1 + given.correction) - given.jump) - 1
    return (reading.correction - now) / reading.correction_sd


def test_a_change_that_is_not_established_widens_the_interval():
    given = Messages(seconds=150.0, per_message=20)
    steady, jumped = (
        read(CLOCK, messages(np.random.default_rng(3), dataclasses.replace(given, jump=jump)))
        for jump in (0.0, 2e-4)
    )
    assert jumped.rate_changes == 0
    assert jumped.correction_sd > 2 * steady.correction_sd
    assert abs(jumped.correction - 0.0102) < 2.5 * jumped.correction_sd


@pytest.mark.long
def test_few_runs_are_as_far_off_as_their_intervals_say():
    far = np.concatenate(list(distances(range(4)).values()))
    assert np.mean(np.abs(far) < 1.96) > 0.8
    assert np.max(np.abs(far)) < 6


@pytest.mark.slow
def test_intervals_of_the_rate_hold_as_often_as_they_say():
    far = distances(range(50))
    pooled = np.concatenate(list(far.values()))
    assert len(pooled) == 350
    assert 0.91 <= np.mean(np.abs(pooled) < 1.96) <= 0.98
    for name, each in far.items():
        assert np.mean(np.abs(each) < 1.96) >= 0.86, name


@pytest.mark.slow
def test_intervals_hold_over_changes_that_are_hard_to_see():
    far = distances(range(50), CHANGES, longest_s=150.0)
    for name, each in far.items():
        assert np.mean(np.abs(each) < 1.96) >= 0.86, name
        assert np.max(np.abs(each)) < 5, name

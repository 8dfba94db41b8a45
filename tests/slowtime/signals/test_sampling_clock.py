import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slowtime.signals.sampling_clock import SamplingClock
from tests.slowtime.signals.latencies import Messages, messages

CLOCK = SamplingClock(nominal_rate_hz=200.0)
SOME = messages(np.random.default_rng(5), Messages(seconds=90.0))


@given(where=st.sets(st.integers(1, len(SOME.index) - 1), max_size=9))
@settings(deadline=None, max_examples=10)
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


@pytest.mark.parametrize("correction", [0.01, -0.01, 1e-4])
def test_the_rate_is_found_within_its_own_interval(correction):
    came = messages(np.random.default_rng(1), Messages(correction=correction))
    reading = CLOCK.read(CLOCK.step(CLOCK.start(), came.index, came.arrival_ns))
    assert abs(reading.correction - correction) < 3.5 * reading.correction_sd
    assert reading.correction_sd < 5e-6

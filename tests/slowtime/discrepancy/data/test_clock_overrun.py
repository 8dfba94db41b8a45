"""What a fast clock told of times after the record is left out; nothing else is."""

import numpy as np
import pytest

from slowtime.discrepancy.data.clock_overrun import INTERPOLATION_SAMPLES, mask_clock_overrun
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.effects import Effect, Place, catalogue

TRIAL = Trial(
    inputs=np.zeros((1000, 1)), outputs=np.ones((1000, 2)), rate_hz=50.0, start_s=30.0
)


def left_out(kind, **parameters):
    effect = Effect(kind, Place("sensor", "b"), parameters)
    (trial,) = mask_clock_overrun((TRIAL,), ("a", "b"), (effect,), catalogue())
    assert trial.used[:, 0].all()
    return np.flatnonzero(~trial.used[:, 1])


def test_a_fast_clock_loses_the_end_of_its_own_channel():
    late = left_out("sensor_clock", skew=0.01)
    assert late[-1] == 999
    assert 10 <= len(late) <= 1.2 * 10 + INTERPOLATION_SAMPLES
    np.testing.assert_array_equal(np.diff(late), 1)


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [
        ("sensor_clock", {"skew": -0.01}),
        ("sensor_clock", {"skew": 0.0}),
        ("sensor_bias", {"bias": 3.0}),
        ("sensor_gain", {"gain": 1.2}),
        ("sensor_saturation", {"clip": 5.0}),
    ],
)
def test_what_stays_within_the_record_is_kept(kind, parameters):
    assert left_out(kind, **parameters).size == 0

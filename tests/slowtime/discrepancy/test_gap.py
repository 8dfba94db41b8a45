"""By what a model is judged where nothing was held out: tails, or pieces too short for one."""

import numpy as np
import pytest

from slowtime.discrepancy.gap import judged, on_heads
from slowtime.discrepancy.records import FEWEST, Trial
from slowtime.discrepancy.refit import refit
from slowtime.dynamics.plant import Plant

from .test_search import TWO, seen


def trial_of(samples):
    noise = np.random.default_rng(1).standard_normal((samples, 1))
    return Trial(inputs=np.zeros((samples, 0)), outputs=noise, rate_hz=50.0)


@pytest.mark.parametrize("samples", [64, 90, 191, 192, 500])
def test_a_tail_is_a_third_where_that_is_a_record_and_else_the_whole(samples):
    trial = trial_of(samples)
    (tail,) = judged((trial,), ())
    third = samples - samples * 2 // 3
    assert len(tail.outputs) == (third if third >= FEWEST else samples)
    np.testing.assert_array_equal(tail.outputs, trial.outputs[-len(tail.outputs) :])
    held = (trial_of(70),)
    assert judged((trial,), held) is held


def test_a_fit_to_short_pieces_is_judged_as_it_is():
    pieces = tuple(one.part(0, 90) for one in seen(()))
    fit = refit(Plant.of(TWO), pieces)
    assert on_heads(fit, pieces) is fit

"""Triggers against ObsPy's, and spans that are widened and joined."""

import warnings

import numpy as np
import pytest

from slowtime.signals.shaking.onsets import Span, merged, spans_above, sta_lta


@pytest.fixture(scope="module")
def trigger():
    with warnings.catch_warnings():
        # ObsPy asks for its plug-ins in a way that importlib deprecates.
        warnings.simplefilter("ignore", DeprecationWarning)
        return pytest.importorskip("obspy.signal.trigger")


def record(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    samples = rng.standard_normal(20_000)
    for at in rng.integers(3_000, 19_000, 4):
        samples[at : at + 200] *= rng.uniform(3, 30)
    return samples


@pytest.mark.parametrize("seed", range(5))
def test_ratio_and_spans_are_those_of_obspy(seed: int, trigger):
    samples = record(seed)
    mine = sta_lta(samples[:, None], 40, 2_000)[:, 0]
    np.testing.assert_allclose(mine, trigger.recursive_sta_lta(samples, 40, 2_000), rtol=1e-9)
    theirs = trigger.trigger_onset(mine, 4.0, 1.2)
    assert [(span.first, span.end - 1) for span in spans_above(mine, 4.0, 1.2)][:-1] == [
        tuple(one) for one in theirs
    ][:-1]
    assert len(theirs) > 0


def test_dead_channel_triggers_nothing():
    assert not sta_lta(np.zeros((5_000, 2)), 10, 100).any()


def test_spans_that_touch_after_widening_are_one_within_the_record():
    spans = [Span(5, 10), Span(40, 50), Span(58, 70), Span(95, 100)]
    assert merged(spans, 6, 4, 100) == [Span(0, 14), Span(34, 74), Span(89, 100)]

"""When a gap is called a disagreement, and how often that is by chance."""

import numpy as np
import pytest

from twin_server.diagnose.gap import IN_A_ROW, learn, limit_factor


@pytest.mark.parametrize(("count", "between"), [(8, 200.0), (30, 500.0)])
def test_two_in_a_row_beyond_the_limit_are_as_rare_as_stated(count, between):
    rng = np.random.default_rng(3)
    runs = 200_000
    learnt = rng.standard_normal((runs, count))
    limit = learnt.mean(axis=1) + limit_factor(count, between) * learnt.std(axis=1, ddof=1)
    beyond = (rng.standard_normal((runs, IN_A_ROW)) > limit[:, None]).all(axis=1)
    expected = runs / between
    assert abs(beyond.sum() - expected) < 5.0 * np.sqrt(expected)


def test_what_is_usual_is_the_typical_gap_and_its_scatter():
    rng = np.random.default_rng(0)
    gaps = 0.03 * np.exp(0.1 * rng.standard_normal(200))
    usual = learn([(gap, 5.0) for gap in gaps], 1e5)
    assert usual.expected == pytest.approx(0.03, rel=0.03)
    assert 0.03 * np.exp(0.25) < usual.limit < 0.03 * np.exp(0.4)
    assert usual.level == pytest.approx(5.0)
    assert usual.readings == 200


def test_a_weaker_record_may_be_further_off_for_its_noise_weighs_more():
    usual = learn([(0.03, 5.0), (0.031, 5.0)] * 5, 1e5)
    assert usual.limit_at(2.5) == pytest.approx(2 * usual.limit)
    assert usual.limit_at(50.0) == usual.limit


def test_a_scatter_of_nothing_does_not_make_every_reading_a_disagreement():
    usual = learn([(0.03, 1.0)] * 10, 1e5)
    assert usual.limit > 1.05 * usual.expected

"""Scores of past forecasts: what an honest forecaster gets, and one who is too sure."""

import numpy as np
import pytest
from scipy.special import ndtri
from scipy.stats import binom

from slowtime.evolution.forecasting import verification
from slowtime.evolution.forecasting.verification import (
    LEVELS,
    binomial_interval,
    effective_number,
    normal_score,
    reliability,
    smoothed_level,
    widening_of,
)


@pytest.mark.parametrize("truth", [-5.0, -1.0, 0.0, 0.3, 4.0])
def test_a_normal_forecast_scores_a_truth_by_its_distance(truth):
    found = normal_score(2.0 + 0.5 * ndtri(LEVELS), 2.0 + 0.5 * truth)
    assert found == pytest.approx(truth, abs=0.06)


def test_a_forecast_without_spread_is_missed_by_all_but_itself():
    assert normal_score(np.ones(9), 1.0) == 0.0
    assert normal_score(np.ones(9), 1.1) > verification.FARTHEST


def test_overlapping_windows_count_as_their_mean_varies():
    """Against simulation: means of increments of a Wiener process over these windows."""
    begin = np.array([0.0, 2.0, 3.0, 3.5, 9.0])
    end = np.array([4.0, 5.0, 7.0, 9.0, 11.0])
    step = 0.01
    rng = np.random.default_rng(3)
    walk = np.sqrt(step) * np.cumsum(rng.standard_normal((4000, 1100)), axis=1)
    walk = np.concatenate([np.zeros((4000, 1)), walk], axis=1)
    a, b = (np.round(each / step).astype(int) for each in (begin, end))
    scores = (walk[:, b] - walk[:, a]) / np.sqrt(end - begin)
    assert effective_number(begin, end) == pytest.approx(1.0 / scores.mean(1).var(), rel=0.08)
    assert effective_number(np.zeros(0), np.zeros(0)) == 0.0


@pytest.mark.parametrize("true", [1.0, 2.0])
def test_a_spread_that_is_too_small_is_widened_toward_the_truth(true):
    rng = np.random.default_rng(4)
    error = np.full(40, 0.3)
    found = [
        widening_of(np.hypot(true, 0.3) * rng.standard_normal(40), error, 40.0)
        for _ in range(60)
    ]
    factors = np.array([one.factor for one in found])
    assert factors.min() >= 1.0
    if true == 1.0:
        assert factors.mean() < 1.05
    else:
        # Clipped scores make it a little smaller.
        assert factors.mean() == pytest.approx(true, rel=0.15)
        assert np.median([one.probability for one in found]) > 0.95


def test_few_independent_statements_move_the_spread_less_and_none_not_at_all():
    score, error = np.full(12, 2.5), np.zeros(12)
    many, few = (widening_of(score, error, number).factor for number in (12.0, 1.5))
    assert many > few > 1.0
    assert widening_of(np.zeros(0), np.zeros(0), 0.0).factor == 1.0
    assert widening_of(0.1 * score, error, 12.0).factor == 1.0


def test_an_honest_forecaster_is_reliable_in_every_class():
    rng = np.random.default_rng(5)
    stated = rng.random(4000)
    came = rng.random(4000) < stated
    begin = np.arange(4000.0)
    found = reliability(stated, came, begin, begin + 1.0)
    assert sum(one.count for one in found) == 4000
    for one in found:
        assert one.low <= one.stated <= one.high
        assert one.effective == pytest.approx(one.count)
        assert one.lo - 0.01 < one.stated < one.hi + 0.01
        assert one.came_true == came[(stated >= one.low) & (stated < one.high)].sum()


def test_binomial_intervals_hold_as_often_as_they_say():
    share = 0.3
    hits = np.arange(21)
    held = [binomial_interval(k / 20, 20.0) for k in hits]
    inside = np.array([lo <= share <= hi for lo, hi in held])
    assert binom.pmf(hits, 20, share) @ inside == pytest.approx(0.95, abs=0.03)
    assert binomial_interval(0.0, 20.0)[0] == 0.0
    assert binomial_interval(1.0, 20.0)[1] == 1.0
    lo, hi = binomial_interval(0.5, 2.0)
    assert hi - lo > held[10][1] - held[10][0]


def test_a_smoothed_level_is_nearer_to_the_truth_and_knows_how_near():
    rng = np.random.default_rng(6)
    time = np.arange(400.0)
    level = np.cumsum(0.01 * rng.standard_normal(400))
    read = level + 0.05 * rng.standard_normal(400)
    mean, sd = smoothed_level(time, read, np.full(400, 0.05))
    away = mean - level
    assert away.std() < 0.5 * (read - level).std()
    assert np.mean((away / sd) ** 2) == pytest.approx(1.0, abs=0.35)
    # A dense solver gives the same, at the rate of the grid that is next to the truth.
    prior = 1e-4 * np.minimum.outer(time, time)
    noise = 0.05**2 * np.eye(400)
    centred = read - read[0]
    dense = read[0] + prior @ np.linalg.solve(prior + noise, centred)
    assert np.abs(dense - mean)[20:].max() < 0.03

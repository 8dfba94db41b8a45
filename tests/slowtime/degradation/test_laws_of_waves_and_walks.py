"""Laws of waves, breaks, walks and runaway growth, against brute force and true values."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

from slowtime import degradation
from slowtime.degradation import CurveLaw
from slowtime.degradation.curve_posterior import BREAK_WIDTH
from slowtime.degradation.curves import (
    BENT,
    BREATHING,
    SEASONAL,
    STEPPED,
    exponential,
    periods_of,
    points_of_periods,
    runaway,
)
from slowtime.degradation.history import LEVEL_WIDTH, history_of
from slowtime.degradation.wiener import (
    MEMORY,
    REVERTING_NODES,
    REVERTING_WIDTH,
    WienerLaw,
)
from slowtime.dynamics.evolution_functions import stiffness_change

TIME = np.linspace(0.0, 100.0, 60)


def readings(truth, sd=0.01, seed=0, time=TIME):
    noise = np.random.default_rng(seed).standard_normal(len(truth))
    return time, truth + sd * noise, np.full(len(truth), sd)


@pytest.mark.parametrize(
    ("curve", "column"),
    [(STEPPED, lambda x: (x > 0.0) * 1.0), (BENT, lambda x: np.maximum(x, 0.0))],
)
def test_the_evidence_of_a_break_is_the_mean_over_its_places(curve, column):
    history = history_of(*readings(-0.002 * TIME - 0.05 * (TIME > 40.0)))
    wide, beside = LEVEL_WIDTH * history.scatter, BREAK_WIDTH * history.scatter
    s = TIME / 100.0
    logs = []
    for place in 0.5 * (s[1:] + s[:-1]):
        own = column(s - place)
        covariance = wide**2 * (1.0 + np.outer(s, s)) + beside**2 * np.outer(own, own)
        logs.append(
            stats.multivariate_normal.logpdf(
                history.value, np.full(60, history.centre), covariance + np.diag(history.sd**2)
            )
        )
    exact = logsumexp(logs) - np.log(len(logs))
    assert CurveLaw(curve).learn(history).log_evidence == pytest.approx(exact, abs=1e-5)


def test_the_evidence_of_a_reverting_walk_is_the_sum_over_gaussian_vectors():
    history = history_of(*readings(-0.001 * TIME + 0.02 * np.sin(TIME)))
    wide, s = LEVEL_WIDTH * history.scatter, TIME / 100.0
    normal = np.linspace(-2.8, 2.8, REVERTING_NODES)
    share = np.exp(-0.5 * normal**2)
    share /= share.sum()
    logs = []
    for u, p in zip(normal, share, strict=True):
        for v, q in zip(normal, share, strict=True):
            around = 0.5 * history.rough * np.exp(REVERTING_WIDTH * u)
            memory = MEMORY * 100.0 * np.exp(REVERTING_WIDTH * v)
            apart = np.abs(np.subtract.outer(TIME, TIME))
            covariance = wide**2 * (1.0 + np.outer(s, s)) + np.diag(history.sd**2)
            covariance += around**2 * np.exp(-apart / memory)
            density = stats.multivariate_normal.logpdf(
                history.value, np.full(60, history.centre), covariance
            )
            logs.append(density + np.log(p * q))
    learnt = WienerLaw("reverting walk", reverts=True).learn(history)
    assert learnt.log_evidence == pytest.approx(logsumexp(logs), abs=1e-5)


@pytest.mark.parametrize("cycles", [2.5, 7.0])
def test_the_oscillating_fade_of_the_book_is_recognised_and_continued(cycles):
    time = np.linspace(0.0, 1000.0, 120)
    wave = {"rate": 4e-4, "ripple": 0.05, "ripple_rate": 2.0 * np.pi * cycles / 1000.0}
    mixture = degradation.learn(*readings(stiffness_change(time, **wave), 0.003, time=time))
    assert mixture.weights["oscillating fade"] > 0.9
    later = mixture.futures(1500.0, points=10)
    true = stiffness_change(later.later, **wave)
    low, high = np.quantile(later.paths, [0.01, 0.99], axis=0)
    assert np.all((low <= true) & (true <= high))
    assert np.all(high - low < 0.03)


def test_the_period_of_a_season_is_learnt():
    truth = -0.001 * TIME + 0.03 * np.cos(2.0 * np.pi * TIME / 14.0 + 1.0)
    learnt = CurveLaw(SEASONAL).learn(history_of(*readings(truth)))
    periods = periods_of(learnt.sample.points[:, 0])
    assert 100.0 / (learnt.weights @ periods) == pytest.approx(14.0, rel=0.01)


def test_numbers_of_periods_and_shape_parameters_are_inverse():
    periods = np.array([0.5, 4.0, 37.0])
    np.testing.assert_allclose(periods_of(points_of_periods(periods)), periods)


def test_runaway_growth_is_a_rate_that_is_a_power_of_the_damage():
    point, age = np.array([[0.3, -0.4]]), np.linspace(0.0, 0.9, 20001)
    damage = runaway(point, age)[0]
    end, order = 1.0 + 0.6 * np.exp(1.2 * 0.3), np.exp(-0.4 * 0.6)
    rate = order / end * damage ** (1.0 + 1.0 / order)
    np.testing.assert_allclose(np.gradient(damage, age)[1:-1], rate[1:-1], rtol=1e-6)


def test_exponential_growth_without_a_rate_is_a_straight_line():
    age = np.linspace(0.0, 2.0, 9)
    np.testing.assert_allclose(exponential(np.zeros((1, 1)), age)[0], age, rtol=1e-5)


def test_readings_that_follow_are_learnt_like_readings_at_once():
    truth = np.exp(-0.004 * TIME) * (1.0 + 0.04 * np.cos(0.3 * TIME)) - 1.0
    time, value, sd = readings(truth)
    for law in (CurveLaw(BREATHING), WienerLaw("reverting walk", reverts=True)):
        begun = law.learn(history_of(time[:50], value[:50], sd[:50]))
        followed = begun.follow(time[50:], value[50:], sd[50:])
        one_by_one = begun
        for i in range(50, 60):
            one = slice(i, i + 1)
            one_by_one = one_by_one.follow(time[one], value[one], sd[one])
        assert one_by_one.log_evidence == followed.log_evidence
        assert followed.log_evidence != begun.log_evidence


@pytest.mark.parametrize("count", [220, 340])
def test_a_fade_that_breathes_is_not_foretold_to_go_on_falling(count):
    """Equation 5.12 with the book's parameters stays above -28 % up to 700 periods."""
    time = np.arange(float(count))
    mixture = degradation.learn(*readings(stiffness_change(time), 0.006, seed=5, time=time))
    assert mixture.remaining_life(-0.35, count + 250.0, toward="below").within < 0.1

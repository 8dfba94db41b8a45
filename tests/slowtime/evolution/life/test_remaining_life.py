"""Remaining life as a distribution."""

import numpy as np
import pytest
from scipy import stats

from slowtime.evolution.life.remaining_life import from_failure_times


def life_of(when, horizon=10.0):
    return from_failure_times(np.asarray(when), threshold=-0.2, now=1.0, horizon=horizon)


def test_distribution_quantiles_and_hazard_are_those_of_the_law_that_was_sampled():
    law = stats.weibull_min(2.0, loc=1.0, scale=3.0)
    times = law.ppf((np.arange(4000) + 0.5) / 4000)
    life = life_of(np.where(times < 5.0, times, np.inf), horizon=5.0)
    at = np.linspace(1.2, 4.8, 20)
    np.testing.assert_allclose(life.cdf(at), law.cdf(at), atol=1e-3)
    np.testing.assert_allclose(life.survival(at), law.sf(at), atol=1e-3)
    np.testing.assert_allclose(life.hazard(at), law.pdf(at) / law.sf(at), rtol=0.05)
    np.testing.assert_allclose(
        life.quantile(np.array([0.1, 0.5])), law.ppf([0.1, 0.5]), rtol=1e-3
    )
    assert life.within == pytest.approx(float(law.cdf(5.0)), abs=1e-3)
    assert life.within + life.beyond == 1.0
    assert np.isinf(life.quantile(0.99))
    assert np.isnan(life.cdf(6.0))


@pytest.mark.parametrize("crossed", [499, 500, 501])
def test_a_median_is_given_wherever_half_is_crossed_within_the_horizon(crossed):
    when = np.where(np.arange(1000) < crossed, np.linspace(2.0, 9.0, 1000), np.inf)
    life = life_of(when)
    assert np.isfinite(life.median) == (life.within >= 0.5) == (crossed >= 500)


def test_what_has_been_crossed_already_lies_at_now():
    life = life_of(np.array([1.0, 1.0, 4.0, np.inf]))
    assert life.already == 0.5
    assert life.median == 1.0
    assert life.quantile(0.75) == pytest.approx(4.0)
    assert life.cdf(0.5) == 0.0
    assert life.cdf(1.0) == 0.5


def test_nothing_crossed_is_said():
    life = life_of(np.full(10, np.inf))
    assert life.within == 0.0
    assert "50 %: not within the horizon of 10" in life.words()
    with pytest.raises(ValueError, match="is not a valid probability"):
        life.quantile(1.5)

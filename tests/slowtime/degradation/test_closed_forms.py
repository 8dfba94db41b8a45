"""Closed forms of survival and first passage against sampling."""

import numpy as np
import pytest
from scipy import stats

from slowtime.degradation import closed_forms
from slowtime.evolution.life.first_passage import first_passage, inverse_gaussian_cdf

PATHS = 4000


def within_sampling_error(found, expected, paths=PATHS):
    """Largest difference of two distribution functions, over that of Kolmogorov at 0.1 %."""
    return np.max(np.abs(found - expected)) <= 1.95 / np.sqrt(paths)


def sampled_cdf(when, at):
    return (when[:, None] <= at).mean(axis=0)


@pytest.mark.parametrize(("mean", "shape"), [(1.0, 1.0), (2.0, 30.0), (0.5, 0.2)])
def test_the_inverse_gaussian_law_is_that_of_scipy(mean, shape):
    at = np.linspace(0.01, 6.0, 50)
    expected = stats.invgauss.cdf(at, mean / shape, scale=shape)
    np.testing.assert_allclose(inverse_gaussian_cdf(at, mean, shape), expected, atol=1e-10)


@pytest.mark.parametrize("sigma", [0.1, 0.5, 2.0])
def test_bridged_paths_of_a_wiener_process_pass_as_the_inverse_gaussian_law_says(sigma):
    rng = np.random.default_rng(3)
    later = np.linspace(0.0, 4.0, 41)
    steps = rng.standard_normal((PATHS, 40)) * np.sqrt(0.1)
    damage = np.pad(np.cumsum(0.1 + sigma * steps, axis=1), ((0, 0), (1, 0)))
    when = first_passage(1.0 - damage, later, np.full(PATHS, sigma**2), rng.random(PATHS))
    at = np.linspace(0.05, 3.95, 37)
    exact = closed_forms.wiener_first_passage(at, distance=1.0, drift=1.0, sigma=sigma)
    assert within_sampling_error(sampled_cdf(when, at), exact)
    if sigma > 0.3:
        unbridged = first_passage(1.0 - damage, later, np.zeros(PATHS), rng.random(PATHS))
        assert not within_sampling_error(sampled_cdf(unbridged, at), exact)


def test_a_drift_away_from_the_threshold_may_never_reach_it():
    never = 1.0 - closed_forms.wiener_first_passage(1e9, distance=2.0, drift=-0.5, sigma=1.0)
    assert never == pytest.approx(1.0 - np.exp(-2.0))


@pytest.mark.parametrize(("alpha", "beta"), [(0.5, 1.0), (5.0, 4.0), (80.0, 60.0)])
def test_sampled_gamma_processes_pass_as_the_closed_form_says(alpha, beta):
    rng = np.random.default_rng(5)
    later = np.linspace(0.0, 6.0, 601)
    steps = rng.gamma(alpha * 0.01, 1.0 / beta, (PATHS, 600))
    damage = np.cumsum(steps, axis=1)
    at = later[1:][::20]
    found = (damage[:, ::20] >= 1.5).mean(axis=0)
    exact = closed_forms.gamma_first_passage(at, distance=1.5, shape_rate=alpha, rate=beta)
    assert within_sampling_error(found, exact)


def test_survival_under_poisson_loads_is_that_of_sampled_events():
    rng = np.random.default_rng(7)
    ahead = np.linspace(0.0, 5.0, 51)
    capacity = rng.normal(3.0, 0.4, PATHS)
    p = np.repeat(stats.norm.sf(capacity)[:, None], 51, axis=1)
    rate = 20.0
    first = rng.exponential(1.0 / (rate * np.maximum(p[:, 0], 1e-300)))
    found = 1.0 - sampled_cdf(first, ahead)
    assert within_sampling_error(found, closed_forms.load_survival(ahead, rate, p))
    constant = closed_forms.load_survival(ahead, rate, np.full((1, 51), 0.01))
    np.testing.assert_allclose(constant, np.exp(-rate * 0.01 * ahead), rtol=1e-12)
    # The average stands outside the exponential: survival is at least that of the mean.
    assert (
        closed_forms.load_survival(ahead, rate, p) >= np.exp(-rate * p.mean() * ahead) - 1e-12
    ).all()


def test_an_unknown_rate_gives_lomax_survival_and_survival_tells_of_the_rate():
    rng = np.random.default_rng(9)
    ahead = np.linspace(0.0, 5.0, 51)
    rates = rng.gamma(2.0, 0.3, PATHS)
    found = closed_forms.load_survival(ahead, rates, np.ones((PATHS, 51)))
    assert within_sampling_error(
        found, closed_forms.gamma_rate_survival(ahead, shape=2.0, scale=0.3)
    )
    later = closed_forms.gamma_rate_survival(ahead + 1.5, shape=2.0, scale=0.3)
    before = closed_forms.gamma_rate_survival(1.5, shape=2.0, scale=0.3)
    shape, scale = closed_forms.rate_given_survival(2.0, 0.3, 1.5)
    np.testing.assert_allclose(
        closed_forms.gamma_rate_survival(ahead, shape=shape, scale=scale), later / before
    )


def test_what_is_no_probability_is_refused():
    with pytest.raises(ValueError, match=r"outside 0 to 1\. Give probabilities"):
        closed_forms.load_survival(np.array([0.0, 1.0]), 1.0, np.array([[0.0, 1.5]]))
    with pytest.raises(ValueError, match=r"distance=.*is not positive"):
        closed_forms.gamma_first_passage(1.0, distance=-1.0, shape_rate=1.0, rate=1.0)

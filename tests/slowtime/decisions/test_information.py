import numpy as np
import pytest
from scipy import stats

from slowtime.decisions import linear_loss, value_of_information
from slowtime.decisions.information import of_a_number, of_detection, of_readings


def normal_states(mean: float, sd: float, count: int = 4001):
    quantiles = stats.norm.ppf((np.arange(count) + 0.5) / count)
    return mean + sd * quantiles, np.full(count, 1.0 / count)


@pytest.mark.parametrize("mean", [0.0, 0.5, -1.0, 1.5, -2.0])
@pytest.mark.parametrize("error", [0.0, 0.5, 1.0])
def test_linear_loss_has_its_closed_form(mean, error):
    """Two actions, of costs 0 and x ~ N(mean, 1), and x observed with an error."""
    x, weights = normal_states(mean, 1.0)
    cost = np.column_stack([np.zeros_like(x), x])
    found = value_of_information(cost, weights, of_a_number(x, weights, error))
    spread = 1.0 / np.hypot(1.0, error)  # of the posterior mean, before the observation
    if abs(mean) > 2.0 * spread:
        pytest.skip("within 1 % up to two standard deviations only")
    assert float(found.value) == pytest.approx(linear_loss(mean, spread), rel=0.01)


def test_unit_normal_loss_is_that_of_quadrature():
    z = np.linspace(-8, 8, 200_001)
    for mean, sd in ((0.0, 1.0), (1.3, 0.7), (-0.4, 2.0)):
        x = mean + sd * z
        saved = min(0.0, mean) - np.trapezoid(np.minimum(0.0, x) * stats.norm.pdf(z), z)
        assert linear_loss(mean, sd) == pytest.approx(saved, rel=1e-6)


def test_no_observation_is_worth_less_than_nothing():
    """In 10,000 random cases, of few and many states, actions and errors."""
    rng = np.random.default_rng(7)
    least = np.inf
    for _ in range(100):
        states, actions = rng.integers(2, 40), rng.integers(2, 9)
        scale = 10.0 ** rng.uniform(-2, 3, (100, 1, 1))
        cost = scale * rng.standard_normal((100, states, actions))
        weights = rng.dirichlet(np.full(states, 10.0 ** rng.uniform(-1, 1)), 100)
        state = 10.0 ** rng.uniform(-2, 2) * rng.standard_normal((100, states))
        sd = 10.0 ** rng.uniform(-4, 2, 100)
        found = value_of_information(cost, weights, of_a_number(state, weights, sd))
        least = min(least, float((found.value / scale[:, 0, 0]).min()))
        perfect = found.prior - (weights * cost.min(axis=-1)).sum(axis=-1)
        assert np.all(found.value <= perfect + 1e-9 * scale[:, 0, 0])
    assert least >= -1e-9


def test_likelihoods_sum_to_one():
    x, weights = normal_states(0.4, 0.3, 201)
    for likelihood in (
        of_a_number(x, weights, 0.1),
        of_detection(x, half=0.3, slope=3.0),
        of_readings(x[:, None] + np.arange(4) * 0.1, np.arange(4.0), weights, 0.2),
    ):
        np.testing.assert_allclose(likelihood.sum(axis=-1), 1.0, atol=1e-12)
        assert likelihood.min() >= 0.0


def test_a_smaller_error_and_more_readings_are_worth_more():
    x, weights = normal_states(0.7, 0.2, 801)
    cost = np.column_stack([np.full_like(x, 1.0), 10.0 * (x > 1.0)])
    worth = [
        float(value_of_information(cost, weights, of_a_number(x, weights, sd)).value)
        for sd in (0.01, 0.05, 0.2, 1.0)
    ]
    assert np.all(np.diff(worth) < 0)
    many = [
        of_readings(np.repeat(x[:, None], n, axis=1), np.arange(float(n)), weights, 0.3)
        for n in (1, 10, 100)
    ]
    told = [float(value_of_information(cost, weights, one).value) for one in many]
    assert np.all(np.diff(told) > 0)


def test_detection_is_worth_what_bayes_says():
    """Two states: damaged with probability 0.3; found with 0.9 if it is, never if not."""
    cost = np.array([[0.0, 2.0], [10.0, 2.0]])
    weights = np.array([0.7, 0.3])
    likelihood = np.array([[1.0, 0.0], [0.1, 0.9]])
    found = value_of_information(cost, weights, likelihood)
    exact = 2.0 - (min(0.73 * 2.0, 0.03 * 10.0) + min(0.27 * 2.0, 0.27 * 10.0))
    assert float(found.value) == pytest.approx(exact, rel=1e-12)
    assert float(found.changes) == pytest.approx(0.73)

import numpy as np
import pytest
from scipy import integrate, optimize, stats

from slowtime.decisions import age_policy


def by_quadrature(shape: float, ratio: float) -> tuple[float, float]:
    """Best age and cost rate of a Weibull life of scale 1, by adaptive quadrature."""
    life = stats.weibull_min(shape)

    def rate(age: float) -> float:
        lived, _ = integrate.quad(life.sf, 0.0, age)
        return float((life.sf(age) + ratio * life.cdf(age)) / lived)

    found = optimize.minimize_scalar(rate, bounds=(1e-3, 5.0), method="bounded")
    return float(found.x), float(found.fun)


@pytest.mark.parametrize("shape", [1.5, 2.0, 3.5, 6.0])
@pytest.mark.parametrize("ratio", [3.0, 10.0, 50.0])
def test_the_age_of_a_weibull_life_is_that_of_quadrature(shape, ratio):
    age = np.linspace(0.0, 5.0, 20_001)
    found = age_policy(age, stats.weibull_min(shape).sf(age), repair=1.0, failure=ratio)
    best, rate = by_quadrature(shape, ratio)
    assert found.cost_rate == pytest.approx(rate, rel=0.002)
    if np.isfinite(found.age):
        assert found.age == pytest.approx(best, rel=0.01)


@pytest.mark.parametrize("shape", [0.5, 0.8, 1.0])
def test_a_life_that_does_not_wear_is_never_repaired_by_age(shape):
    life = stats.weibull_min(shape)
    age = np.concatenate([[0.0], np.geomspace(1e-8, 200.0, 40_001)])
    found = age_policy(age, life.sf(age), repair=1.0, failure=20.0, mean_life=life.mean())
    assert found.age == np.inf
    assert found.cost_rate == pytest.approx(20.0 / life.mean(), rel=1e-6)


def test_the_mean_life_is_completed_behind_the_grid():
    age = np.linspace(0.0, 2.0, 2001)
    found = age_policy(age, np.exp(-age), repair=1.0, failure=2.0)
    assert found.never_rate == pytest.approx(2.0, rel=1e-3)


def test_what_is_no_survival_function_is_refused():
    with pytest.raises(ValueError, match="falls from at most 1"):
        age_policy(np.arange(3.0), np.array([1.0, 0.5, 0.7]), repair=1.0, failure=2.0)

import numpy as np
import pytest

from slowtime.surrogate import NetworkEnsemble, PlainProcess, SupportVectors

MEMBERS = [
    SupportVectors(extrapolation="ignore"),
    NetworkEnsemble(extrapolation="ignore"),
    PlainProcess(extrapolation="ignore"),
]
members = pytest.mark.parametrize("member", MEMBERS, ids=lambda one: type(one).__name__)


def function(x):
    return np.sin(3.0 * x[:, 0]) + x[:, 1] ** 2


@members
def test_a_smooth_function_is_learnt_and_the_band_holds_it(member):
    rng = np.random.default_rng(0)
    x, new = rng.uniform(size=(60, 2)), rng.uniform(size=(500, 2))
    fitted = member.fit(x, function(x))
    error = fitted.predict(new) - function(new)
    assert np.sqrt(np.mean(error**2)) < 0.1 * function(new).std()
    lo, hi = fitted.predict_interval(new)
    assert np.mean((lo <= function(new)) & (function(new) <= hi)) > 0.85


def test_a_conformal_band_holds_new_readings_whatever_the_noise():
    inside = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        x = rng.uniform(size=(240, 1))
        y = np.sin(6.0 * x[:, 0]) + 0.1 * rng.standard_t(3, size=240)
        fitted = SupportVectors(
            grid={"C": [10.0], "gamma": [1.0], "epsilon": [0.1]}, extrapolation="ignore"
        ).fit(x[:60], y[:60])
        lo, hi = fitted.predict_interval(x[60:], 0.9)
        inside.append(np.mean((lo <= y[60:]) & (y[60:] <= hi)))
    assert np.mean(inside) == pytest.approx(0.9, abs=0.04)


def test_a_level_that_the_points_cannot_support_is_refused():
    x = np.linspace(0.0, 1.0, 12)[:, None]
    fitted = SupportVectors().fit(x, np.sin(6.0 * x[:, 0]))
    with pytest.raises(ValueError, match=r"12 points say nothing of a 95 % band.*Ask for 92 %"):
        fitted.predict_interval(x, 0.95)


def test_networks_disagree_most_where_there_are_no_points():
    x = np.concatenate([np.linspace(0.0, 0.4, 30), np.linspace(0.8, 1.0, 15)])[:, None]
    fitted = NetworkEnsemble().fit(x, np.sin(12.0 * x[:, 0]))
    _, sd = fitted.predict([[0.2], [0.6]], return_std=True)
    assert sd[1] > 2.0 * sd[0]


def test_the_same_seed_gives_the_same_networks():
    x = np.linspace(0.0, 1.0, 20)[:, None]
    one, other, third = (
        NetworkEnsemble(random_state=seed).fit(x, np.sin(6.0 * x[:, 0])).predict([[0.33]])
        for seed in (1, 1, 2)
    )
    assert one == other != third

import numpy as np
import pytest
from scipy.optimize import check_grad
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern

from slowtime.surrogate import GaussianProcess, HybridExpansion, homotopy
from slowtime.surrogate.bases import PolynomialBasis, indices
from slowtime.surrogate.gaussian_processes.covariances import (
    Expanded,
    Stationary,
    SumCovariance,
    covariance,
)
from slowtime.surrogate.gaussian_processes.regression import RegressionData, condition
from slowtime.surrogate.problems import PROBLEMS

NAMES = [
    "matern12",
    "matern32",
    "matern52",
    "squared exponential",
    "periodic",
    "matern52 + periodic",
]


def readings(points=25, columns=1, seed=0, noise=0.05):
    rng = np.random.default_rng(seed)
    x = rng.uniform(size=(points, 2))
    y = np.sin(5.0 * x[:, 0]) + x[:, 1] ** 2
    trend = np.column_stack([np.ones(points), x])[:, :columns]
    return RegressionData(x, trend, y, rng.uniform(0.5, 1.5, points) * noise**2)


def expanded():
    problem = PROBLEMS["Ishigami"]
    terms = indices(2, 4)[1:]
    laws = [problem.marginals[0]] * 2
    return Expanded(
        terms, PolynomialBasis(laws, terms, np.full(2, -np.pi), np.full(2, 2.0 * np.pi))
    )


@pytest.mark.parametrize("columns", [0, 1, 3])
@pytest.mark.parametrize("name", [*NAMES, "expanded"])
def test_slopes_of_the_likelihood_are_its_differences(name, columns):
    kind = (
        SumCovariance((expanded(), covariance("matern52")))
        if name == "expanded"
        else covariance(name)
    )
    data = readings(columns=columns)

    def value(theta):
        return condition(kind, theta, 0.01, data).log_likelihood

    def slope(theta):
        state = condition(kind, theta, 0.01, data)
        weight = 0.5 * (np.outer(state.weights, state.weights) - state.projected)
        return kind.slopes(theta, data.x, weight)

    theta = np.random.default_rng(1).normal(-0.3, 0.3, len(kind.ranges(2)))
    assert check_grad(value, slope, theta) < 1e-4 * np.linalg.norm(slope(theta))


@pytest.mark.parametrize(
    ("name", "theirs"),
    [
        ("squared exponential", RBF([0.4, 0.7])),
        ("matern12", Matern([0.4, 0.7], nu=0.5)),
        ("matern32", Matern([0.4, 0.7], nu=1.5)),
        ("matern52", Matern([0.4, 0.7], nu=2.5)),
    ],
)
def test_without_a_trend_it_is_the_process_of_scikit_learn(name, theirs):
    data = readings(columns=0)
    theta = np.log([1.3, 0.4, 0.7])
    ours = condition(covariance(name), theta, 0.0, data)
    peer = GaussianProcessRegressor(
        ConstantKernel(1.3**2) * theirs, alpha=data.variance, optimizer=None
    ).fit(data.x, data.y)
    assert ours.log_likelihood == pytest.approx(peer.log_marginal_likelihood_value_, rel=1e-10)
    new = np.random.default_rng(5).uniform(size=(9, 2))
    mean, variance = ours.predict(new, np.empty((9, 0)))
    expected, sd = peer.predict(new, return_std=True)
    np.testing.assert_allclose(mean, expected, atol=1e-10)
    np.testing.assert_allclose(np.sqrt(variance), sd, atol=1e-8)


def test_a_trend_is_the_limit_of_a_process_with_coefficients_of_any_size():
    data = readings(columns=3)
    theta = np.log([0.5, 0.4, 0.7])
    ours = condition(Stationary(), theta, 0.0, data)
    new = np.random.default_rng(5).uniform(size=(9, 2))
    columns = np.column_stack([np.ones(9), new])
    huge = 1e5
    own, cross = (
        Stationary().between(theta, data.x, data.x),
        Stationary().between(theta, data.x, new),
    )
    matrix = own + huge * data.trend @ data.trend.T + np.diag(data.variance)
    cross = cross + huge * data.trend @ columns.T
    mean, variance = ours.predict(new, columns)
    np.testing.assert_allclose(mean, cross.T @ np.linalg.solve(matrix, data.y), atol=1e-5)
    prior = Stationary().variance(theta, new) + huge * np.sum(columns**2, axis=1)
    dense = prior - np.sum(cross * np.linalg.solve(matrix, cross), axis=0)
    np.testing.assert_allclose(variance, dense, atol=1e-5)


def test_leaving_one_out_is_what_it_says():
    data = readings(columns=3)
    theta = np.log([0.5, 0.4, 0.7])
    error, sd = condition(Stationary(), theta, 0.02, data).left_out()
    for i in (0, 7):
        rest = np.arange(25) != i
        part = RegressionData(data.x[rest], data.trend[rest], data.y[rest], data.variance[rest])
        mean, variance = condition(Stationary(), theta, 0.02, part).predict(
            data.x[[i]], data.trend[[i]]
        )
        assert error[i] == pytest.approx(data.y[i] - mean[0])
        assert sd[i] ** 2 == pytest.approx(variance[0] + data.variance[i] + 0.02**2)


def test_noise_that_is_known_is_not_learnt_into_the_function():
    rng = np.random.default_rng(3)
    x = np.sort(rng.uniform(size=(60, 1)), axis=0)
    truth = np.sin(6.0 * x[:, 0])
    noise = np.where(np.arange(60) % 2, 0.5, 0.02)
    y = truth + noise * rng.standard_normal(60)
    known = GaussianProcess(nugget=0.0).fit(x, y, noise_sd=noise)
    blind = GaussianProcess().fit(x, y)
    error = [np.sqrt(np.mean((one.predict(x) - truth) ** 2)) for one in (known, blind)]
    assert error[0] < 0.5 * error[1]
    mean, sd = known.predict(x, return_std=True)
    assert np.sqrt(np.mean(((mean - truth) / sd) ** 2)) < 1.6
    with pytest.raises(ValueError, match=r"noise_sd of shape \(3,\) for 60 outputs"):
        known.fit(x, y, noise_sd=np.ones(3))


def test_a_wave_is_continued_by_a_periodic_process_only():
    # Not even: an alias of the period would do as well on a grid.
    x = np.sort(np.random.default_rng(4).uniform(0.0, 6.0, (40, 1)), axis=0)
    y = np.sin(2.0 * np.pi * x[:, 0])
    new = np.linspace(6.5, 9.0, 20)[:, None]
    wave, plain = (
        GaussianProcess(kernel, starts=1, folds=1, extrapolation="ignore").fit(x, y)
        for kernel in ("periodic", "matern52")
    )
    expected = np.sin(2.0 * np.pi * new[:, 0])
    assert np.abs(wave.predict(new) - expected).max() < 0.02
    assert np.abs(plain.predict(new) - expected).max() > 0.3


def test_without_residual_and_noise_the_trend_is_homotopy_regression():
    kind = expanded()
    data = readings(points=10, columns=0, noise=1e-7)
    theta = np.random.default_rng(2).normal(-0.3, 0.3, len(kind.ranges(2)))
    state = condition(kind, theta, 0.0, data)
    found = kind.variances(theta) * (kind.design(data.x).T @ state.weights)
    expected = homotopy(kind.design(data.x), data.y, 1.0 / kind.variances(theta))
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_its_trend_and_its_residual_make_the_prediction():
    problem = PROBLEMS["Ishigami"]
    x, y = problem.design(60, np.random.default_rng(0))
    surrogate = HybridExpansion(degree=4, nugget=1e-3, starts=1, folds=1).fit(x, y)
    unit = surrogate._unit(x)
    design = PolynomialBasis(
        surrogate.marginals_, surrogate.terms_, surrogate.domain_.lo, surrogate._width()
    )(unit)
    trend = surrogate.constant_ + design @ surrogate.coefficients_
    whole = surrogate.process_.covariance
    assert isinstance(whole, SumCovariance)
    stationary = whole.parts[1]
    theta = surrogate.process_.theta[-len(stationary.ranges(3)) :]
    residual = stationary.between(theta, unit, unit) @ surrogate.process_.weights
    np.testing.assert_allclose(
        trend + surrogate.y_scale_ * residual, surrogate.predict(x), atol=1e-8
    )


@pytest.mark.parametrize(
    "make", [GaussianProcess, pytest.param(HybridExpansion, marks=pytest.mark.slow)]
)
def test_its_band_holds_about_as_often_as_it_says_where_the_likelihood_alone_is_too_sure(make):
    problem = PROBLEMS["frame"]
    held: dict[int, list[float]] = {1: [], 5: []}
    for seed in range(2):
        x, y = problem.design(50, np.random.default_rng(seed))
        new, truth = problem.draws(200, np.random.default_rng(100 + seed))
        for folds, inside in held.items():
            fitted = make(starts=1, folds=folds, extrapolation="ignore").fit(x, y)
            lo, hi = fitted.predict_interval(new)
            inside.append(np.mean((lo <= truth) & (truth <= hi)))
    assert np.mean(held[1]) < np.mean(held[5])
    assert np.mean(held[5]) > 0.88


def test_names_that_mean_nothing_are_refused():
    x, y = np.linspace(0.0, 1.0, 12)[:, None], np.arange(12.0)
    with pytest.raises(ValueError, match=r"'rbf' is not a valid covariance function\. Allowed"):
        GaussianProcess("rbf").fit(x, y)
    with pytest.raises(ValueError, match=r"trend='cubic' is not known"):
        GaussianProcess(trend="cubic").fit(x, y)

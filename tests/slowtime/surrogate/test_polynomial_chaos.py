import numpy as np
import pytest
from scipy import stats

from slowtime.surrogate import IllConditionedWarning, NothingLearntWarning, PolynomialChaos
from slowtime.surrogate.bases import indices, products
from slowtime.surrogate.least_squares import all_of, nested
from slowtime.surrogate.problems import PROBLEMS, ishigami_sobol

ISHIGAMI = PROBLEMS["Ishigami"]


def fitted(points, seed=0, **settings):
    x, y = ISHIGAMI.design(points, np.random.default_rng(seed))
    return PolynomialChaos(marginals=ISHIGAMI.marginals, **settings).fit(x, y)


def test_sobol_indices_of_ishigami_are_right_to_one_per_cent():
    surrogate = fitted(200)
    first, total = ishigami_sobol()
    np.testing.assert_allclose(surrogate.sobol_first_, first, atol=0.01 * first.max())
    np.testing.assert_allclose(surrogate.sobol_total_, total, rtol=0.01)
    assert surrogate.sobol(0, 2) == pytest.approx(total[0] - first[0], rel=0.01)
    assert surrogate.mean_ == pytest.approx(3.5, rel=0.01)
    assert surrogate.variance_ == pytest.approx(13.8446, rel=0.01)


def test_a_polynomial_is_found_exactly_whatever_the_law():
    rng = np.random.default_rng(1)
    laws = [stats.norm(2.0, 0.5), stats.lognorm(0.3), stats.uniform(-1.0, 3.0)]
    x = np.column_stack([law.rvs(60, random_state=rng) for law in laws])
    surrogate = PolynomialChaos(marginals=laws).fit(x, 1.0 + x[:, 0] * x[:, 1] - x[:, 2] ** 2)
    new = x[:7] * 0.99 + 0.01 * x.mean(axis=0)
    np.testing.assert_allclose(
        surrogate.predict(new), 1.0 + new[:, 0] * new[:, 1] - new[:, 2] ** 2, atol=1e-7
    )
    mean = 1.0 + 2.0 * laws[1].mean() - (laws[2].var() + laws[2].mean() ** 2)
    assert surrogate.mean_ == pytest.approx(mean, rel=1e-6)


def left_out(design, y):
    errors = []
    for i in range(len(y)):
        rest = np.arange(len(y)) != i
        errors.append(y[i] - design[i] @ np.linalg.lstsq(design[rest], y[rest])[0])
    return np.mean(np.square(errors))


def test_leave_one_out_is_what_leaving_one_out_gives():
    x, y = ISHIGAMI.design(40, np.random.default_rng(2))
    design = products(x, ISHIGAMI.marginals, indices(3, 3))
    size = design.shape[1]
    gram = np.linalg.inv(design.T @ design)
    factor = 40 / (40 - size) * (1.0 + np.trace(gram))
    assert all_of(design, y).loo == pytest.approx(factor * left_out(design, y))
    order = np.arange(size)
    found = nested(design, y, order)
    kept = design[:, found.terms]
    factor = 40 / (40 - len(found.terms)) * (1.0 + np.trace(np.linalg.inv(kept.T @ kept)))
    assert found.loo == pytest.approx(factor * left_out(kept, y))
    np.testing.assert_allclose(found.coefficients, np.linalg.lstsq(kept, y)[0])


def test_columns_that_others_span_are_left_out():
    rng = np.random.default_rng(3)
    design = rng.standard_normal((20, 4))
    design[:, 2] = design[:, 0] - design[:, 1]
    found = nested(design, design @ [1.0, 1.0, 0.0, 1.0], np.arange(4))
    assert found.terms.tolist() == [0, 1, 3]


def test_its_band_holds_the_function_about_as_often_as_it_says():
    inside = []
    for seed in range(2):
        surrogate = fitted(80, seed, extrapolation="ignore")
        x, y = ISHIGAMI.draws(1000, np.random.default_rng(100 + seed))
        lo, hi = surrogate.predict_interval(x)
        inside.append(np.mean((lo <= y) & (y <= hi)))
    assert np.mean(inside) > 0.9


def test_what_cannot_be_fitted_says_what_to_change():
    with pytest.raises(ValueError, match=r"30 points do not suffice.*lower degree"):
        fitted(30, degree=6, method="least squares", q_norm=1.0)
    with pytest.raises(ValueError, match=r"method='ridge' is not known"):
        fitted(30, method="ridge")
    x, y = ISHIGAMI.design(30, np.random.default_rng(0))
    with pytest.raises(ValueError, match=r"2 marginals were given for 3 inputs"):
        PolynomialChaos(marginals=ISHIGAMI.marginals[:2]).fit(x, y)
    with pytest.raises(ValueError, match=r"beyond its marginal's \[0, 1\]"):
        PolynomialChaos(marginals=[stats.uniform()] * 3).fit(x, y)


def test_a_design_of_clusters_is_warned_of():
    rng = np.random.default_rng(5)
    x = np.repeat([[-1.0], [0.0], [1.0]], 10, axis=0) + 1e-7 * rng.standard_normal((30, 1))
    with pytest.warns(IllConditionedWarning, match="condition number"):
        PolynomialChaos(degree=4, method="least squares").fit(x, np.exp(x[:, 0]))


def test_an_output_that_no_input_explains_is_foretold_by_its_mean_and_said_so():
    rng = np.random.default_rng(6)
    x, y = rng.uniform(size=(40, 3)), rng.standard_normal(40)
    with pytest.warns(NothingLearntWarning, match="No term foretells better than the mean"):
        surrogate = PolynomialChaos(degree=1, method="lars").fit(x, y)
    mean, sd = surrogate.predict(x, return_std=True)
    np.testing.assert_allclose(mean, y.mean())
    np.testing.assert_allclose(sd, y.std(), rtol=0.1)
    assert not surrogate.sobol_total_.any()

import numpy as np
import pytest
from scipy import stats

from slowtime.surrogate import GeneralisedAnova
from slowtime.surrogate.gaussian_processes.anova import joint
from slowtime.surrogate.problems import PROBLEMS, ishigami_sobol


def correlated(points, rho, rng):
    return rng.multivariate_normal([0.0, 0.0], [[1.0, rho], [rho, 1.0]], size=points)


def test_shares_of_a_plane_in_correlated_inputs_are_those_by_hand():
    rho, a, b = 0.6, 2.0, -1.0
    x = correlated(60, rho, np.random.default_rng(0))
    fitted = GeneralisedAnova(degree=2, marginals=[stats.norm()] * 2, starts=1, folds=1).fit(
        x, a * x[:, 0] + b * x[:, 1]
    )
    sample = correlated(40000, rho, np.random.default_rng(1))
    shares = {one.inputs: one for one in fitted.shares(sample)}
    variance = a**2 + b**2 + 2.0 * rho * a * b
    for which, own in (((0,), a), ((1,), b)):
        assert shares[which].structural == pytest.approx(own**2 / variance, rel=0.03)
        assert shares[which].correlated == pytest.approx(rho * a * b / variance, rel=0.05)
    assert shares[(0, 1)].structural < 1e-6
    assert sum(one.whole for one in shares.values()) == pytest.approx(1.0)


def test_a_product_of_correlated_inputs_is_shared_by_hierarchy():
    """For normal inputs, x1 x2 = rho / (1 + rho²) (x1² + x2²) + what is orthogonal to both."""
    rho = 0.5
    x = correlated(60, rho, np.random.default_rng(2))
    fitted = GeneralisedAnova(degree=2, marginals=[stats.norm()] * 2, starts=1, folds=1).fit(
        x, x[:, 0] * x[:, 1]
    )
    sample = correlated(60000, rho, np.random.default_rng(3))
    parts = fitted.components(sample)
    for k in (0, 1):
        for power in (1, 2):
            assert abs(np.mean(parts[(0, 1)] * sample[:, k] ** power)) < 1e-9
    slope = np.polyfit(sample[:, 0], parts[(0,)], 2)[0]
    assert slope == pytest.approx(rho / (1.0 + rho**2), rel=0.05)


def test_of_independent_inputs_the_shares_are_sobol_indices():
    problem = PROBLEMS["Ishigami"]
    x, y = problem.design(150, np.random.default_rng(4))
    fitted = GeneralisedAnova(marginals=problem.marginals, starts=1, folds=1).fit(x, y)
    sample, _ = problem.draws(20000, np.random.default_rng(5))
    shares = {one.inputs: one for one in fitted.shares(sample)}
    first, total = ishigami_sobol()
    assert shares[(0,)].whole == pytest.approx(first[0], abs=0.02)
    assert shares[(1,)].whole == pytest.approx(first[1], abs=0.02)
    assert shares[(0, 2)].whole == pytest.approx(total[2], abs=0.02)
    assert all(abs(one.correlated) < 0.02 for one in shares.values())


def test_draws_have_the_correlation_and_the_marginals_of_the_design():
    x = np.exp(correlated(2000, 0.7, np.random.default_rng(6)))
    drawn = joint(x)
    assert stats.spearmanr(*drawn.T)[0] == pytest.approx(stats.spearmanr(*x.T)[0], abs=0.02)
    np.testing.assert_allclose(
        np.quantile(drawn, 0.9, axis=0), np.quantile(x, 0.9, axis=0), rtol=0.03
    )
    given = joint(x, [stats.uniform(), stats.norm(5.0)])
    assert given[:, 0].max() <= 1.0
    assert given[:, 1].mean() == pytest.approx(5.0, abs=0.05)


def test_three_inputs_at_a_time_have_no_decomposition_here():
    with pytest.raises(ValueError, match=r"interaction=3 has no decomposition"):
        GeneralisedAnova(interaction=3).fit(
            *PROBLEMS["Ishigami"].design(40, np.random.default_rng(0))
        )

"""Marginals, dependence, and the map between them and standard normal space."""

import numpy as np
import pytest
from scipy import stats

from slowtime.reliability import (
    FAMILIES,
    ClaytonCopula,
    Conditional,
    Copula,
    FrankCopula,
    GumbelCopula,
    Problem,
    StudentCopula,
    correlated,
    estimate,
    marginal,
)
from slowtime.reliability.random_inputs.copulas import kendall

PARAMETERS = {
    "mean": 3.0, "sd": 0.7, "lo": 0.0, "hi": 8.0, "mode": 2.0, "a": 2.0, "b": 3.0,
    "location": 1.0, "scale": 2.0, "shape": 3.0, "log_mean": 0.5, "log_sd": 0.3,
    "parent_mean": 3.0, "parent_sd": 2.0, "freedom": 5.0,
}  # fmt: skip
WAYS = [(name, wanted) for name, ways in FAMILIES.items() for wanted, _ in ways]


@pytest.mark.parametrize(("name", "wanted"), WAYS)
def test_scores_and_values_of_every_marginal_are_inverse_to_each_other(name, wanted):
    law = marginal(name, **{key: PARAMETERS[key] for key in wanted})
    z = np.linspace(-6.0, 6.0, 25)
    x = law.of_score(z)
    assert np.all(np.diff(x) > 0.0)
    np.testing.assert_allclose(law.score(x), z, atol=1e-5)
    lo, hi = law.law.support()
    assert np.all((x >= lo) & (x <= hi))


@pytest.mark.parametrize(("name", "wanted"), [w for w in WAYS if "sd" in w[1]])
def test_a_marginal_by_its_moments_has_these_moments(name, wanted):
    law = marginal(name, **{key: PARAMETERS[key] for key in wanted})
    assert law.mean == pytest.approx(3.0, rel=1e-6)
    assert law.sd == pytest.approx(0.7, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "parameters", "said"),
    [
        ("gauss", {"mean": 0.0}, r"'gauss' is not known\. Allowed: normal"),
        ("normal", {"mean": 0.0}, r"'normal' takes \(mean, sd\), not \(mean\)"),
        ("normal", {"mean": 0.0, "sd": -1.0}, r"sd=-1 .* is not positive"),
        ("uniform", {"lo": 2.0, "hi": 1.0}, r"lo=2 .* is not below hi=1"),
        ("lognormal", {"mean": -1.0, "sd": 1.0}, r"mean=-1 .* is not positive"),
        ("beta", {"mean": 0.5, "sd": 0.9, "lo": 0.0, "hi": 1.0}, r"does not fit into"),
        ("normal", {"mean": float("nan"), "sd": 1.0}, r"is not finite"),
    ],
)
def test_a_marginal_that_is_none_is_refused_with_what_is_allowed(name, parameters, said):
    with pytest.raises(ValueError, match=said):
        marginal(name, **parameters)


COPULAS: dict[str, tuple[Copula, float]] = {
    "clayton": (ClaytonCopula(2.0), 2.0 / 4.0),
    "gumbel": (GumbelCopula(2.0), 1.0 - 1.0 / 2.0),
    # Of Frank's copula with theta 5.7363 Kendall's correlation is a half.
    "frank": (FrankCopula(5.7363), 0.5),
    "student": (StudentCopula(np.array([[1.0, 0.5], [0.5, 1.0]]), 4.0), 1.0 / 3.0),
}


@pytest.mark.parametrize("name", COPULAS)
def test_a_copula_is_inverted_and_has_kendalls_correlation_of_its_closed_form(name):
    copula, tau = COPULAS[name]
    u = np.random.default_rng(1).standard_normal((2000, 2))
    z = copula.scores(u)
    np.testing.assert_allclose(copula.independent(z), u, atol=1e-5)
    assert stats.kstest(z[:, 1], "norm").pvalue > 1e-3
    assert kendall(copula) == pytest.approx(tau, abs=0.03)


@pytest.mark.parametrize("kind", ["linear", "spearman", "kendall"])
def test_nataf_inputs_have_the_correlation_that_was_asked_for(kind):
    inputs = {
        "a": marginal("lognormal", mean=1.0, sd=0.8),
        "b": marginal("gumbel", mean=2.0, sd=0.5),
        "c": marginal("uniform", lo=0.0, hi=1.0),
    }
    dependence = correlated(inputs, {("a", "b"): 0.5, ("b", "c"): -0.4}, kind)
    problem = Problem(inputs, lambda x: x[:, 0], dependence)
    x = problem.physical(np.random.default_rng(0).standard_normal((40_000, 3)))
    measure = {
        "linear": lambda a, b: np.corrcoef(a, b)[0, 1],
        "spearman": lambda a, b: stats.spearmanr(a, b).statistic,
        "kendall": lambda a, b: stats.kendalltau(a[:6000], b[:6000]).statistic,
    }[kind]
    assert measure(x[:, 0], x[:, 1]) == pytest.approx(0.5, abs=0.03)
    assert measure(x[:, 1], x[:, 2]) == pytest.approx(-0.4, abs=0.03)


def test_correlations_that_no_inputs_can_have_are_refused():
    wide = {name: marginal("lognormal", mean=1.0, sd=3.0) for name in "ab"}
    with pytest.raises(ValueError, match="Lower it, or give a rank correlation"):
        correlated(wide, {("a", "b"): -0.9})
    three = {name: marginal("normal", mean=0.0, sd=1.0) for name in "abc"}
    with pytest.raises(ValueError, match="not positive definite"):
        correlated(three, {("a", "b"): 0.9, ("b", "c"): 0.9, ("a", "c"): -0.9})
    with pytest.raises(ValueError, match=r"\['d'\] are no inputs"):
        correlated(three, {("a", "d"): 0.1})


def test_correlated_normal_inputs_have_the_index_of_the_book():
    """Eq. 4.8: (muR - muS) / sqrt(sR² + sS² - 2 rho sR sS)."""
    inputs = {
        "r": marginal("normal", mean=10.0, sd=1.2),
        "s": marginal("normal", mean=5.0, sd=0.9),
    }
    problem = Problem(
        inputs, lambda x: x[:, 0] - x[:, 1], correlated(inputs, {("r", "s"): 0.4})
    )
    exact = 5.0 / np.sqrt(1.44 + 0.81 - 2.0 * 0.4 * 1.2 * 0.9)
    assert estimate(problem, "form").beta == pytest.approx(exact, rel=1e-6)
    assert estimate(problem, "mean-value").beta == pytest.approx(exact, rel=1e-3)


def test_a_conditional_input_is_a_rosenblatt_transformation():
    """With s given r normal about 0.3 r, r - s is normal."""
    problem = Problem(
        {
            "r": marginal("normal", mean=10.0, sd=1.0),
            "s": Conditional(lambda earlier: stats.norm(0.3 * earlier[:, 0], 1.0)),
        },
        lambda x: x[:, 0] - x[:, 1],
    )
    assert estimate(problem, "form").beta == pytest.approx(7.0 / np.hypot(0.7, 1.0), rel=1e-6)
    u = np.random.default_rng(0).standard_normal((50, 2))
    np.testing.assert_allclose(problem.standard(problem.physical(u)), u, atol=1e-9)


def test_tail_dependence_is_seen_in_the_probability():
    """Clayton's joint lower tail: P(both < p) = (2 p^-theta - 1)^(-1/theta)."""
    inputs = {name: marginal("uniform", lo=0.0, hi=1.0) for name in "ab"}
    both = Problem(inputs, lambda x: x.max(axis=1) - 0.01, {("a", "b"): ClaytonCopula(2.0)})
    exact = (2.0 * 0.01**-2.0 - 1.0) ** -0.5
    found = estimate(both, "directional", variation=0.04)
    assert found.probability == pytest.approx(exact, rel=0.16)


def test_inputs_and_groups_that_do_not_fit_are_refused():
    law = marginal("normal", mean=0.0, sd=1.0)
    with pytest.raises(ValueError, match="Give at least one"):
        Problem({}, lambda x: x[:, 0])
    with pytest.raises(TypeError, match="is not a valid distribution"):
        Problem({"a": 3.0}, lambda x: x[:, 0])
    with pytest.raises(ValueError, match="'z' cannot be joined"):
        Problem({"a": law}, lambda x: x[:, 0], {("a", "z"): ClaytonCopula(1.0)})

"""Designs beside those of the literature, closed forms and brute force."""

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from slowtime.design import Constraint, DesignProblem, Effort, Variable, optimise
from slowtime.design.inverse_form import worst_points
from slowtime.reliability import Problem, correlated, marginal, unknowns

INPUTS = {
    "yield": marginal("normal", mean=40e3, sd=2e3),
    "modulus": marginal("normal", mean=29e6, sd=1.45e6),
    "x": marginal("normal", mean=500.0, sd=100.0),
    "y": marginal("normal", mean=1000.0, sd=100.0),
}


def yielding(d, x):
    w, t = d.T
    return x[:, 0] - 600 * x[:, 3] / (w * t**2) - 600 * x[:, 2] / (w**2 * t)


def deflection(d, x):
    w, t = d.T
    return 2.2535 - 4e6 / (x[:, 1] * w * t) * np.hypot(x[:, 3] / t**2, x[:, 2] / w**2)


def problem(variables, inputs, objective, constraints=None, alpha=1.0, dependence=None):
    whole = Problem(inputs, lambda x: x[:, 0], dependence or {})
    return DesignProblem(variables, whole, objective, constraints or {}, alpha)


def test_a_cantilever_has_the_area_of_the_literature():
    accepted = float(ndtr(-3.0))
    found = optimise(
        problem(
            {"w": Variable(lower=1.0, upper=4.0), "t": Variable(lower=1.0, upper=5.0)},
            INPUTS,
            lambda d, x: d.prod(axis=1),
            {"y": Constraint(yielding, accepted), "d": Constraint(deflection, accepted)},
        )
    )
    assert found.best.mean == pytest.approx(9.520, abs=0.005)
    for one in found.best.constraints.values():
        assert one.found.beta == pytest.approx(3.0, abs=0.01)
    assert found.feasible
    assert not found.warnings
    assert not found.bounds


def test_a_short_column_ends_at_the_bound_of_its_depth():
    inputs = {
        "yield": marginal("lognormal", mean=5.0, sd=0.5),
        "moment": marginal("normal", mean=2000.0, sd=400.0),
        "force": marginal("normal", mean=500.0, sd=100.0),
    }

    def g(d, x):
        b, h = d.T
        strength, moment, force = x.T
        return 1 - 4 * moment / (b * h**2 * strength) - (force / (b * h * strength)) ** 2

    accepted = float(ndtr(-2.5))
    asked = problem(
        {"b": Variable(lower=5.0, upper=15.0), "h": Variable(lower=15.0, upper=25.0)},
        inputs,
        lambda d, x: d.prod(axis=1),
        {"column": Constraint(g, accepted)},
        dependence=correlated(inputs, {("moment", "force"): 0.5}),
    )
    found = optimise(asked)
    assert found.bounds == {"h": "upper"}
    # Brute force: the same normal scores at a lattice of widths.
    scores = np.random.default_rng(5).standard_normal((400_000, 3))
    x = asked.inputs.physical(scores)
    widths = np.linspace(8.0, 9.4, 71)
    failed = [np.mean(g(np.tile([b, 25.0], (len(x), 1)), x) <= 0) for b in widths]
    least = np.interp(-np.log(accepted), -np.log(failed), widths)
    assert found.best.variables[0] == pytest.approx(least, rel=0.003)


@pytest.mark.parametrize("alpha", [1.0, 0.6, 0.0])
def test_moments_are_those_of_a_linear_objective(alpha):
    """Mean 3 + (d - 1)^2 and standard deviation 0.5 + d: the optimum is a formula."""
    found = optimise(
        problem(
            {"d": Variable(lower=0.0, upper=3.0, start=2.0)},
            unknowns(1),
            lambda d, x: 3.0 + (d[:, 0] - 1.0) ** 2 + (0.5 + d[:, 0]) * x[:, 0],
            alpha=alpha,
        )
    )
    mean, sd = found.reference
    assert (mean, sd) == pytest.approx((4.0, 2.5), rel=0.01)
    best = max(1.0 - (1 - alpha) * mean / (2 * alpha * sd), 0.0) if alpha else 0.0
    assert found.best.variables[0] == pytest.approx(best, abs=0.01)
    assert found.best.value <= found.start.value


def test_curvature_that_first_order_misses_is_corrected():
    """Failure outside a circle: first order finds exp(-r^2/2) four times too small."""
    found = optimise(
        problem(
            {"r": Variable(lower=1.0, upper=6.0)},
            unknowns(2),
            lambda d, x: d[:, 0],
            {"circle": Constraint(lambda d, x: d[:, 0] - np.hypot(*x.T), 1e-3)},
        ),
        effort=Effort(method="directional", variation=0.01),
    )
    exact = np.sqrt(-2.0 * np.log(1e-3))
    assert found.best.variables[0] == pytest.approx(exact, rel=0.003)
    assert exact > 1.15 * -ndtri(1e-3)


def test_where_no_design_is_safe_enough_the_nearest_is_told():
    found = optimise(
        problem(
            {"d": Variable(lower=0.0, upper=2.0)},
            unknowns(1),
            lambda d, x: d[:, 0],
            {"far": Constraint(lambda d, x: d[:, 0] - x[:, 0], 1e-3)},
        )
    )
    assert found.best.variables[0] == pytest.approx(2.0, abs=1e-3)
    assert not found.feasible
    assert any("No design within the bounds meets" in said for said in found.warnings)


def test_the_same_seed_gives_the_same_design():
    asked = problem(
        {"d": Variable(lower=0.0, upper=5.0)},
        unknowns(2),
        lambda d, x: d[:, 0] ** 2,
        {"g": Constraint(lambda d, x: d[:, 0] - x[:, 0] * x[:, 1], 0.01)},
    )
    one, other = optimise(asked, seed=3), optimise(asked, seed=3)
    assert one.best.variables == other.best.variables


def test_a_function_that_returns_nothing_says_at_which_design():
    asked = problem(
        {"d": Variable(lower=-1.0, upper=1.0)}, unknowns(1), lambda d, x: np.log(d[:, 0])
    )
    with np.errstate(invalid="ignore"), pytest.raises(ValueError, match=r"NaN at the design"):
        optimise(asked)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Variable(lower=2.0, upper=1.0), "Give finite bounds"),
        (lambda: Variable(lower=0.0, upper=1.0, start=3.0), "outside the bounds"),
        (lambda: Constraint(yielding, 0.7), "at most 0.5"),
        (lambda: problem({}, unknowns(1), yielding), "nothing to choose"),
        (lambda: problem({"d": Variable(lower=0.0, upper=1.0)}, unknowns(1), yielding,
                         alpha=2.0), "outside \\[0, 1\\]"),
    ],
)  # fmt: skip
def test_what_is_no_problem_is_refused(make, text):
    with pytest.raises(ValueError, match=text):
        make()


@pytest.mark.parametrize("seed", range(6))
def test_the_worst_point_is_the_least_value_on_the_sphere(seed):
    rng = np.random.default_rng(seed)
    way, bend = rng.standard_normal(3), 0.1 * rng.standard_normal((3, 3))

    def g(u):
        return 4.0 + u @ way + np.einsum("si,ij,sj->s", u, bend, u)

    _, values = worst_points(Problem(unknowns(3), g), 2.5, np.random.default_rng(1))
    sphere = rng.standard_normal((400_000, 3))
    sphere *= 2.5 / np.linalg.norm(sphere, axis=1, keepdims=True)
    least = g(sphere).min()
    assert least - 0.02 * abs(least) - 1e-3 <= values[0] <= least + 1e-6
    assert (np.diff(values) >= 0.0).all()

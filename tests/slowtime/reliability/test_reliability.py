"""Laws that every method of the family obeys."""

import numpy as np
import pytest
from scipy import stats

from slowtime.reliability import (
    METHODS,
    Outcrossing,
    Problem,
    Search,
    Stopping,
    System,
    estimate,
    form,
    importance,
    marginal,
    outcrossing,
    sorm,
    system,
    unknowns,
)
from slowtime.reliability.design_points.system import ditlevsen, joint
from tests.slowtime.reliability.problems import (
    QUADRATURE,
    closed_forms,
    directions,
    every,
    four_branch,
    parabola,
    plane,
    series_of_planes,
    sphere,
    two_sided,
)

SAMPLERS = [name for name, method in METHODS.items() if method.interval and name != "active"]
QUICK = plane(2.5, 2)
EXACT = float(stats.norm.sf(2.5))


def ends(found):
    assert found.interval is not None
    return found.interval


def error(found):
    """Coefficient of variation of a result that has one."""
    assert found.variation is not None
    return found.variation


@pytest.mark.parametrize("method", SAMPLERS)
def test_a_sampling_method_holds_a_plane_within_four_standard_errors(method):
    found = estimate(QUICK, method, variation=0.1, seed=3)
    assert found.method == method
    assert found.probability == pytest.approx(EXACT, rel=4.0 * error(found))
    lo, hi = ends(found)
    assert lo < found.probability < hi
    assert error(found) <= 0.1
    assert found.warnings == ()


@pytest.mark.parametrize("method", [name for name in METHODS if name != "active"])
def test_the_same_seed_gives_the_same_result_and_calls_are_counted(method):
    counted = []

    def g(u):
        counted.append(len(u))
        return 2.5 - u.sum(axis=1) / np.sqrt(2.0)

    problem = Problem(unknowns(2), g)
    first = estimate(problem, method, variation=0.2, seed=5)
    assert first.calls == sum(counted)
    again = estimate(problem, method, variation=0.2, seed=5)
    assert (again.probability, again.calls) == (first.probability, first.calls)


@pytest.mark.parametrize("method", [m for m, one in METHODS.items() if not one.interval])
def test_an_approximation_is_exact_for_a_plane_and_gives_no_interval(method):
    found = estimate(plane(3.0, 3), method)
    assert found.beta == pytest.approx(3.0, abs=1e-5)
    assert found.interval is None
    assert "approximation" in found.no_interval


@pytest.mark.parametrize("method", ["monte-carlo", "importance", "subset", "directional"])
def test_a_target_that_the_calls_do_not_allow_is_told(method):
    found = estimate(plane(3.0, 4), method, variation=0.01, calls=2000)
    assert any("calls" in warning for warning in found.warnings)


def test_monte_carlo_gives_up_below_1e_4_and_says_so():
    found = estimate(plane(6.0, 2), "monte-carlo")
    assert "below 0.0001" in found.warnings[0]
    assert found.calls < 200_000
    assert ends(found)[0] == 0.0


@pytest.mark.parametrize("method", [name for name in METHODS if name != "mean-value"])
def test_nan_is_an_error_that_names_the_point_and_the_cure(method):
    broken = Problem(unknowns(2), lambda u: np.where(u[:, 0] > 1.0, np.nan, 3.0 - u[:, 1]))
    with pytest.raises(ValueError, match=r"NaN at \d+ points, such as u1=.*invalid='fails'"):
        estimate(broken, method)


def test_nan_counts_as_failed_where_told():
    wall = Problem(
        unknowns(2), lambda u: np.where(u[:, 0] > 2.5, np.nan, 9.0 - u[:, 1]), invalid="fails"
    )
    for method in ("monte-carlo", "subset", "directional"):
        found = estimate(wall, method, variation=0.1)
        assert found.probability == pytest.approx(EXACT, rel=4.0 * error(found)), method


@pytest.mark.parametrize("method", [name for name in SAMPLERS if name != "monte-carlo"])
def test_where_the_margin_is_no_number_is_failure_to_every_method(method):
    known = closed_forms()["root of a margin"]
    found = [estimate(known.problem, method, seed=seed) for seed in range(3)]
    each = [one.probability / known.exact for one in found]
    spread = np.mean([error(one) for one in found])
    assert np.mean(each) == pytest.approx(1.0, abs=4.0 * spread / np.sqrt(3))


@pytest.mark.long
def test_active_learning_takes_what_is_no_number_for_failure():
    def g(x):
        return np.where(x[:, 0] > 0.0, np.abs(x[:, 0]) ** 0.5, np.nan)

    root = Problem({"a": marginal("normal", mean=3.0, sd=1.0)}, g, invalid="fails")
    found = estimate(root, "active")
    assert found.probability == pytest.approx(stats.norm.sf(3.0), rel=0.3)
    assert "count as failed" in found.warnings[0]


def test_importance_sampling_sees_failures_that_lie_far_before_the_tangent_plane():
    known = closed_forms()["lognormals 100"]
    found = [estimate(known.problem, "importance", seed=seed) for seed in (97, 99, 100)]
    for one in found:
        assert one.design_points[0].probability < 0.05 * known.exact
        assert not one.warnings
        assert one.probability == pytest.approx(known.exact, rel=4.0 * error(one))
        assert one.calls < 30_000


@pytest.mark.parametrize("wrong", [lambda u: 3.0, lambda u: u, lambda u: u[:1, 0]])
def test_a_wrong_shape_is_an_error_that_says_which_is_right(wrong):
    with pytest.raises(ValueError, match=r"returned shape .* Return one value per point"):
        estimate(Problem(unknowns(2), wrong), "monte-carlo")


def test_all_four_design_points_of_the_four_branch_problem_are_found():
    found = form(four_branch(6.0), np.random.default_rng(1), Stopping())
    # Two parabolas at distance 3, two planes at distance 6 / sqrt(2) / sqrt(2) = 3.
    assert [round(point.beta, 3) for point in found.design_points] == [3.0] * 4


def test_importance_sampling_is_right_where_one_design_point_is_a_quarter_of_it():
    ratios = [
        importance(four_branch(6.0), np.random.default_rng(seed), Stopping()).probability
        for seed in range(12)
    ]
    exact = QUADRATURE["four-branch 6"].exact
    assert np.mean(ratios) == pytest.approx(exact, rel=4.0 * 0.05 / np.sqrt(12))
    assert min(ratios) > 0.8 * exact


def test_importance_sampling_sees_all_planes_of_a_series():
    exact = every()["series of 20 planes"].exact
    found = [
        importance(series_of_planes(), np.random.default_rng(seed), Stopping())
        for seed in range(8)
    ]
    assert np.mean([len(one.design_points) for one in found]) > 19.0
    assert np.mean([one.probability for one in found]) == pytest.approx(
        exact, rel=4.0 * 0.05 / np.sqrt(8)
    )


def test_sorm_corrects_a_paraboloid_as_breitung_and_tvedt_say():
    """The surface u2 = 3 + 0.3 u1² has its curvature 0.6 at distance 3."""
    rng = np.random.default_rng(0)
    breitung = sorm(parabola(3.0, -0.3), rng, Stopping())
    assert breitung.probability == pytest.approx(
        stats.norm.sf(3.0) / np.sqrt(1.0 + 3.0 * 0.6), rel=1e-3
    )
    tvedt = sorm(parabola(3.0, -0.3), rng, Stopping(), formula="tvedt")
    exact = QUADRATURE["parabola 3 -0.3"].exact
    assert abs(tvedt.probability / exact - 1.0) < abs(breitung.probability / exact - 1.0)
    assert tvedt.probability == pytest.approx(exact, rel=0.01)


def test_a_mean_value_index_depends_on_how_the_event_is_written_and_form_does_not():
    """Eq. 4.8 gives 5 / 1.5; eq. 4.9 of the logarithm gives another index (erratum E19)."""
    inputs = {
        "r": marginal("normal", mean=10.0, sd=1.2),
        "s": marginal("normal", mean=5.0, sd=0.9),
    }
    plain = Problem(inputs, lambda x: x[:, 0] - x[:, 1])
    ratio = Problem(inputs, lambda x: np.log(np.maximum(x[:, 0] / x[:, 1], 1e-9)))
    assert estimate(plain, "mean-value").beta == pytest.approx(10.0 / 3.0)
    assert estimate(ratio, "mean-value").beta == pytest.approx(
        np.log(2.0) / np.hypot(0.12, 0.18), rel=1e-3
    )
    assert estimate(plain, "form").beta == pytest.approx(10.0 / 3.0)
    assert estimate(ratio, "form").beta == pytest.approx(10.0 / 3.0, rel=1e-3)


def test_sensitivities_of_form_are_derivatives_of_its_index():
    def index(mean, sd):
        inputs = {
            "r": marginal("gumbel", mean=mean, sd=sd),
            "s": marginal("normal", mean=5.0, sd=0.9),
        }
        problem = Problem(inputs, lambda x: x[:, 0] - x[:, 1])
        return form(problem, np.random.default_rng(0), Stopping(), search=Search(rounds=0))

    point = index(10.0, 1.2).design_points[0]
    by_mean = (index(10.1, 1.2).beta - index(9.9, 1.2).beta) / 0.2
    by_sd = (index(10.0, 1.25).beta - index(10.0, 1.15).beta) / 0.1
    assert point.mean_sensitivity["r"] == pytest.approx(by_mean, rel=1e-2)
    assert point.sd_sensitivity["r"] == pytest.approx(by_sd, rel=1e-2)
    assert np.sum(point.importance) == pytest.approx(1.0)


def test_a_series_system_lies_within_ditlevsens_bounds_and_equals_sampling():
    ways = directions(6, 3, seed=2)
    parts = {f"plane{k}": (lambda x, a=a: 2.5 - x @ a) for k, a in enumerate(ways)}
    problem = Problem(unknowns(3), System("series", parts))
    found = system(problem, np.random.default_rng(0), Stopping(), search=Search(rounds=0))
    lo, hi = found.bounds or (0.0, 0.0)
    assert lo <= found.probability <= hi
    assert hi / lo < 1.2
    sampled = estimate(problem, "directional", variation=0.03)
    assert found.probability == pytest.approx(sampled.probability, rel=0.12)


def test_a_parallel_system_of_two_planes_is_the_bivariate_normal_tail():
    parts = {"a": lambda u: 2.0 - u[:, 0], "b": lambda u: 2.0 - 0.6 * u[:, 0] - 0.8 * u[:, 1]}
    problem = Problem(unknowns(2), System("parallel", parts))
    found = system(problem, np.random.default_rng(0), Stopping(), search=Search(rounds=0))
    assert found.probability == pytest.approx(joint(2.0, 2.0, 0.6), rel=1e-3)
    assert (found.bounds or (0.0, 0.0))[1] == pytest.approx(joint(2.0, 2.0, 0.6), rel=1e-6)


@pytest.mark.parametrize("rho", [-0.9, -0.3, 0.0, 0.5, 0.99])
def test_a_joint_tail_equals_the_bivariate_normal_distribution(rho):
    law = stats.multivariate_normal([0.0, 0.0], [[1.0, rho], [rho, 1.0]])
    assert joint(1.0, 1.5, rho) == pytest.approx(law.cdf([-1.0, -1.5]), abs=1e-6)


def test_ditlevsens_bounds_of_equal_planes_are_one_plane():
    lo, hi = ditlevsen(np.array([3.0, 3.0]), np.ones((2, 2)))
    assert lo == pytest.approx(stats.norm.sf(3.0))
    assert hi == pytest.approx(stats.norm.sf(3.0))


def test_directions_are_exact_for_a_sphere():
    found = estimate(sphere(stats.chi2.isf(1e-5, 10), 10), "directional")
    assert found.probability == pytest.approx(1e-5, rel=2e-3)


def test_a_limit_state_that_never_fails_has_no_interval_and_a_warning():
    safe = Problem(unknowns(2), lambda u: 1.0 + 0.0 * u[:, 0])
    for method in ("importance", "subset", "cross-entropy", "directional"):
        found = estimate(safe, method, calls=20_000)
        assert found.probability == 0.0, method
        assert found.interval is None, method
        assert found.warnings, method


def test_a_safe_set_that_does_not_hold_the_origin_has_a_negative_index():
    found = estimate(plane(-1.0, 3), "form")
    assert found.beta == pytest.approx(-1.0, abs=1e-4)
    sampled = estimate(plane(-1.0, 3), "importance")
    assert sampled.probability == pytest.approx(stats.norm.sf(-1.0), rel=0.2)


def test_an_unknown_method_and_a_senseless_target_are_refused():
    with pytest.raises(ValueError, match=r"'sorm' is not known\. Allowed: mean-value"):
        estimate(QUICK, "sorm")
    with pytest.raises(ValueError, match=r"variation=5 is outside \(0, 1\)"):
        estimate(QUICK, "subset", variation=5.0)


def test_outcrossing_of_a_gaussian_process_is_rices_rate():
    r"""Rice: nu = w0 / (2 pi) exp(-b²/2), for autocorrelation exp(-(w0 tau)²/2)."""
    b, omega = 3.0, 2.0
    process = {
        "s": marginal("normal", mean=0.0, sd=1.0),
        "r": marginal("normal", mean=b, sd=1e-6),
    }
    problem = Problem(process, lambda x: x[:, 1] - x[:, 0])
    found = outcrossing(
        lambda _time: problem,
        np.array([0.0, 1.0, 2.0]),
        {"s": lambda lag: float(np.exp(-0.5 * (omega * lag) ** 2))},
        correlation_time=1.0,
    )
    assert isinstance(found, Outcrossing)
    rice = omega / (2.0 * np.pi) * np.exp(-0.5 * b**2)
    np.testing.assert_allclose(found.rate, rice, rtol=0.01)
    assert found.upper[-1] == pytest.approx(stats.norm.sf(b) + 2.0 * rice, rel=0.01)
    assert np.all(found.poisson <= found.upper + 1e-12)


def bowl(inputs=2):
    """A limit state that rises in every direction and never fails."""
    return Problem(unknowns(inputs), lambda u: 3.0 + 0.1 * np.sum(u**2, axis=1))


@pytest.mark.parametrize("method", ["form", "sorm-breitung", "system"])
def test_where_nothing_fails_the_search_says_so_and_asks_for_no_point_that_is_none(method):
    with pytest.raises(ValueError, match=r"[Nn]o (part|design point).*Use a sampling method"):
        estimate(bowl(), method)


@pytest.mark.parametrize(
    ("problem", "method", "calls"),
    [
        pytest.param(bowl(), "importance", 5_000, id="never fails"),
        pytest.param(plane(45.0, 2), "importance", 5_000, id="below the least number"),
        pytest.param(plane(45.0, 2), "active", 8, id="below the least number, by a process"),
    ],
)
def test_where_nothing_fails_a_sampling_method_gives_no_interval(problem, method, calls):
    found = estimate(problem, method, calls=calls)
    assert found.probability == 0.0
    assert found.variation == np.inf
    assert (found.interval, found.no_interval) == (None, "nothing failed")
    assert "no failure" in found.warnings[-1] or "No sampled point" in found.warnings[-1]


@pytest.mark.parametrize("beta", [8.0, 20.0, 30.0, 35.0])
def test_importance_sampling_holds_a_plane_however_improbable(beta):
    """The squares of these probabilities are below the least number of double precision."""
    found = estimate(plane(beta, 2), "importance", seed=2)
    exact = float(stats.norm.sf(beta))
    assert 0.01 < error(found) < 0.05
    assert found.probability == pytest.approx(exact, rel=4.0 * error(found))


@pytest.mark.long
@pytest.mark.parametrize("name", ["four-branch 6", "parabola 3 -0.3"])
def test_active_learning_needs_few_runs(name):
    known = QUADRATURE[name]
    found = estimate(known.problem, "active")
    assert found.calls <= 80
    assert ends(found)[0] < known.exact < ends(found)[1]


@pytest.mark.long
def test_two_sided_failure_one_in_a_million_is_seen_on_both_sides():
    for method in ("importance", "cross-entropy", "subset", "stratified"):
        found = estimate(two_sided(4.891638), method, seed=1)
        assert found.probability == pytest.approx(1e-6, rel=4.0 * error(found)), method

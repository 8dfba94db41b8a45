import csv

import numpy as np
import pytest
from scipy import stats

from slowtime.reliability import (
    design_points,
    directional,
    importance,
    monte_carlo,
    physical,
    subset_simulation,
)


def plane(beta):
    return lambda u: beta - u.sum(axis=1) / np.sqrt(u.shape[1])


def sphere(square):
    return lambda u: square - np.sum(u**2, axis=1)


def two_sided(beta):
    return lambda u: beta - np.abs(u[:, 0])


def exponentials(most):
    return physical(lambda x: most - x.sum(axis=1), [stats.expon()] * 5)


# Exact values: Phi(-beta), Q(n/2, r²/2), 2 Phi(-beta), Q(n, a).
CASES = {
    "plane, 2 inputs": (plane(stats.norm.isf(1e-4)), 2, 1e-4),
    "plane, 100 inputs": (plane(stats.norm.isf(1e-4)), 100, 1e-4),
    "sphere, 10 inputs": (sphere(stats.chi2.isf(1e-4, 10)), 10, 1e-4),
    "two-sided": (two_sided(stats.norm.isf(0.5e-4)), 2, 1e-4),
    "sum of exponentials": (exponentials(stats.gamma.isf(1e-4, 5)), 5, 1e-4),
    "plane, one in a million": (plane(stats.norm.isf(1e-6)), 10, 1e-6),
    "two-sided, one in a million": (two_sided(stats.norm.isf(0.5e-6)), 2, 1e-6),
}


def runs(method, name, count, **settings):
    function, inputs, exact = CASES[name]
    found = [
        method(function, inputs, np.random.default_rng(seed), **settings)
        for seed in range(count)
    ]
    values = np.array([one.value for one in found]) / exact
    held = np.mean([one.lo <= exact <= one.hi for one in found])
    told = np.mean([one.variation for one in found])
    return values, held, told


@pytest.mark.long
@pytest.mark.parametrize("name", list(CASES))
def test_subset_simulation_is_right_on_average_and_knows_its_error(name):
    values, held, told = runs(subset_simulation, name, 30, samples=1000)
    assert values.mean() == pytest.approx(1.0, abs=4.0 * values.std() / np.sqrt(30))
    assert values.std() < 0.8
    assert 0.6 < told / values.std() < 2.2
    assert held > 0.85


@pytest.mark.parametrize(
    "name", ["plane, 2 inputs", "plane, 100 inputs", "two-sided", "plane, one in a million"]
)
def test_importance_about_design_points_is_right(name):
    values, held, told = runs(importance, name, 20, calls=2000)
    assert values.mean() == pytest.approx(1.0, abs=4.0 * values.std() / np.sqrt(20))
    assert told == pytest.approx(values.std(), rel=0.6)
    assert held > 0.8


def test_directions_are_exact_for_a_sphere_and_right_for_others():
    values, _, told = runs(directional, "sphere, 10 inputs", 2, directions=5)
    np.testing.assert_allclose(values, 1.0, rtol=0.02)
    assert told < 1e-9
    for name in ("plane, 2 inputs", "two-sided, one in a million", "sum of exponentials"):
        values, held, told = runs(directional, name, 20, directions=400)
        assert values.mean() == pytest.approx(1.0, abs=0.02 + 4.0 * values.std() / np.sqrt(20))
        assert told == pytest.approx(values.std(), rel=0.6)
        assert held > 0.7


def test_monte_carlo_has_an_exact_interval_even_with_no_failure():
    held = []
    for seed in range(60):
        found = monte_carlo(plane(2.0), 2, np.random.default_rng(seed), calls=2000)
        held.append(found.lo <= stats.norm.sf(2.0) <= found.hi)
    assert np.mean(held) > 0.9
    none = monte_carlo(plane(8.0), 2, np.random.default_rng(0), calls=1000)
    assert (none.value, none.lo, none.variation) == (0.0, 0.0, np.inf)
    assert none.hi == pytest.approx(3.0 / 1000, rel=0.01)
    assert "0 of 1000 points failed" in none.warnings[0]


def test_both_of_two_equally_near_points_are_found():
    found = design_points(two_sided(3.0), 3, np.random.default_rng(0), starts=12)
    assert sorted(round(float(one.point[0]), 4) for one in found) == [-3.0, 3.0]
    assert found[0].first_order == pytest.approx(stats.norm.sf(3.0))


def test_strength_over_load_has_the_index_of_the_book():
    """Eq. 4.8: beta = (muR - muS) / sqrt(sR² + sS²)."""
    function = physical(
        lambda x: x[:, 0] - x[:, 1], [stats.norm(10.0, 1.2), stats.norm(5.0, 0.9)]
    )
    found = design_points(function, 2, np.random.default_rng(0))[0]
    assert found.beta == pytest.approx(5.0 / 1.5)
    # The same event written otherwise has the same index, which eq. 4.9 does not grant.
    ratio = physical(
        lambda x: np.log(x[:, 0] / x[:, 1]), [stats.norm(10.0, 1.2), stats.norm(5.0, 0.9)]
    )
    again = design_points(ratio, 2, np.random.default_rng(0))[0]
    assert again.beta == pytest.approx(found.beta, rel=1e-4)
    assert again.first_order == pytest.approx(stats.norm.sf(5.0 / 1.5), rel=1e-3)


def test_importance_about_a_wrong_point_says_so():
    far = [one for one in design_points(plane(3.0), 2, np.random.default_rng(0))]
    found = importance(
        lambda u: 3.0 + u[:, 0], 2, np.random.default_rng(0), calls=3000, points=far
    )
    assert "carries" in found.warnings[0] or "No point failed" in found.warnings[0]


def test_what_cannot_be_asked_is_refused_and_what_is_too_rare_is_said():
    with pytest.raises(ValueError, match="do not make chains of whole length"):
        subset_simulation(plane(3.0), 2, np.random.default_rng(0), samples=1005)
    with pytest.raises(ValueError, match="No design point was found"):
        design_points(lambda u: np.ones(len(u)), 2, np.random.default_rng(0))
    never = subset_simulation(
        lambda u: 1.0 + np.exp(-np.sum(u**2, axis=1)), 2, np.random.default_rng(0), samples=100
    )
    assert never.value == 0.0
    assert "rarer than 15 levels reach" in never.warnings[0]
    with pytest.raises(ValueError, match="Give one law for each input"):
        exponentials(3.0)(np.zeros((1, 2)))


def test_openturns_finds_the_same():
    ot = pytest.importorskip("openturns")
    law = ot.JointDistribution([ot.LogNormal(0.5, 0.1), ot.LogNormal(0.0, 0.2), ot.Normal()])
    event = ot.ThresholdEvent(
        ot.CompositeRandomVector(
            ot.SymbolicFunction(["r", "s", "n"], ["r - s + 0.02 * n"]), ot.RandomVector(law)
        ),
        ot.Less(),
        0.0,
    )
    form = ot.FORM(ot.Cobyla(), event, [1.6, 1.0, 0.0])
    form.run()
    ours = physical(
        lambda x: x[:, 0] - x[:, 1] + 0.02 * x[:, 2],
        [stats.lognorm(0.1, scale=np.exp(0.5)), stats.lognorm(0.2), stats.norm()],
    )
    found = design_points(ours, 3, np.random.default_rng(0))[0]
    expected = form.getResult().getHasoferReliabilityIndex()
    assert found.beta == pytest.approx(expected, rel=1e-3)


@pytest.mark.slow
def test_every_exact_value_of_the_table_lies_where_subset_simulation_says(tables):
    families = {
        "linear": lambda n, p: plane(p),
        "hypersphere": lambda n, p: sphere(p),
        "series_two_sided": lambda n, p: two_sided(p),
        "sum_exponentials": lambda n, p: physical(
            lambda x: p - x.sum(axis=1), [stats.expon()] * n
        ),
    }
    with (tables / "T5_reliability_exact.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["problem"] in families]
    held = []
    for k, row in enumerate(rows):
        inputs = int(row["n"])
        function = families[row["problem"]](inputs, float(row["parameters"].split("=")[1]))
        exact = float(row["Pf_exact"])
        for seed in range(5):
            found = subset_simulation(function, inputs, np.random.default_rng([k, seed]))
            held.append(found.lo <= exact <= found.hi)
    assert len(rows) > 40
    assert np.mean(held) > 0.9

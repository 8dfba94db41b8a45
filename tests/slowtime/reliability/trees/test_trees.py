"""Reliability trees against enumeration, closed forms, quadrature and sampling."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, stats
from scipy.optimize import linprog

from slowtime.reliability import trees
from slowtime.reliability.trees import (
    CommonCause,
    Equicorrelated,
    Group,
    analyse,
    any_dependence,
    band,
    fails,
    k_of_n,
    members,
    parallel,
    probability,
    series,
    simulate,
)
from slowtime.reliability.trees.diagram import Diagram

NAMES = tuple("abcdef")
LEAVES = st.sampled_from(NAMES)


def grown(node):
    """Make a tree of nested lists: tenths of the inputs that must work, and inputs."""
    if isinstance(node, str):
        return node
    share, inputs = node
    return k_of_n(1 + share * (len(inputs) - 1) // 10, *map(grown, inputs))


SKETCHES = st.recursive(
    LEAVES,
    lambda inputs: st.tuples(st.integers(0, 10), st.lists(inputs, min_size=1, max_size=4)),
    max_leaves=12,
)
CHANCES = st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6)


def states():
    """All states of six members, as columns."""
    return dict(
        zip(NAMES, np.array(list(itertools.product([False, True], repeat=6))).T, strict=True)
    )


def enumerated(tree, marginals):
    """Sum the probabilities of all states in which the tree fails."""
    failed = states()
    chance = np.prod(
        [np.where(failed[n], marginals[n], 1 - marginals[n]) for n in NAMES], axis=0
    )
    return float(np.sum(chance[fails(tree, failed)]))


def cut_sets(tree):
    """Minimal cut sets by trying all sets of members."""
    names = members(tree)
    cuts: list[tuple[str, ...]] = []
    for size in range(len(names) + 1):
        for chosen in itertools.combinations(names, size):
            one = {name: np.array([name in chosen]) for name in names}
            if fails(tree, one)[0] and not any(set(cut) <= set(chosen) for cut in cuts):
                cuts.append(chosen)
    return cuts


@given(sketch=SKETCHES, chances=CHANCES)
@settings(max_examples=80, deadline=None)
def test_the_probability_is_the_sum_over_all_states_whatever_members_share(sketch, chances):
    tree = grown(sketch)
    marginals = dict(zip(NAMES, chances, strict=True))
    found = analyse(tree, marginals)
    assert found.probability == pytest.approx(enumerated(tree, marginals), abs=1e-12)
    lo, hi = found.bounds
    assert lo - 1e-12 <= found.probability <= hi + 1e-12


@given(sketch=SKETCHES, chances=CHANCES)
@settings(max_examples=40, deadline=None)
def test_importances_are_what_their_definitions_say(sketch, chances):
    tree = grown(sketch)
    marginals = dict(zip(NAMES, chances, strict=True))
    found, failed = analyse(tree, marginals), states()
    cuts, whole = cut_sets(tree), enumerated(tree, marginals)
    chance = np.prod(
        [np.where(failed[n], marginals[n], 1 - marginals[n]) for n in NAMES], axis=0
    )
    for name in members(tree):
        yes = fails(tree, failed | {name: np.ones(64, dtype=bool)})
        no = fails(tree, failed | {name: np.zeros(64, dtype=bool)})
        critical = yes & ~no
        in_cut = np.any(
            [np.all([failed[n] for n in cut], axis=0) for cut in cuts if name in cut]
            or [np.zeros(64, dtype=bool)],
            axis=0,
        )
        one = found.importance[name]
        assert one.birnbaum == pytest.approx(float(chance[critical].sum()), abs=1e-12)
        if whole > 1e-9:
            both = float(chance[critical & failed[name]].sum())
            assert one.criticality == pytest.approx(both / whole, abs=1e-6)
            assert one.fussell_vesely == pytest.approx(chance[in_cut].sum() / whole, abs=1e-6)


@given(sketch=SKETCHES)
@settings(max_examples=60, deadline=None)
def test_minimal_cut_sets_are_those_that_enumeration_finds(sketch):
    tree = grown(sketch)
    diagram, names = Diagram(), members(tree)
    root = diagram.build(tree, {name: number for number, name in enumerate(names)})
    found = {
        frozenset(names[i] for i in one) for one in diagram.sets(diagram.minimal(root), 10_000)
    }
    assert found == {frozenset(cut) for cut in cut_sets(tree)}


def test_a_gate_of_equal_independent_members_is_binomial():
    names = [f"m{i}" for i in range(40)]
    p = probability(k_of_n(31, *names), {n: np.array([0.03, 0.4]) for n in names})
    np.testing.assert_allclose(p, stats.binom.sf(9, 40, [0.03, 0.4]), rtol=1e-11)


@pytest.mark.parametrize("rho", [0.0, 0.01, 0.3, 0.8, 0.99, 0.999])
@pytest.mark.parametrize("p", [1e-9, 1e-4, 0.2])
def test_two_equicorrelated_members_fail_as_the_bivariate_normal_does(rho, p):
    marginals = {"a": p, "b": 0.3}
    found = analyse(parallel("a", "b"), marginals, [Equicorrelated(("a", "b"), rho)])
    a, b = map(float, stats.norm.ppf(np.array([p, 0.3])))

    def density(x):
        return stats.norm.pdf(x) * stats.norm.cdf((b - rho * x) / math.sqrt(1 - rho**2))

    truth, _ = integrate.quad(
        density, -40, a, epsabs=0, epsrel=1e-11, points=[min(b, a - 1), a - 1]
    )
    assert found.probability == pytest.approx(truth, rel=1e-8)


@given(chances=CHANCES, beta=st.floats(0, 1), rho=st.floats(0, 0.99))
@settings(max_examples=25, deadline=None)
def test_a_member_keeps_its_own_probability_in_any_group(chances, beta, rho):
    marginals = dict(zip(NAMES, chances, strict=True))
    groups: list[Group] = [
        CommonCause(("a", "b", "c"), beta),
        Equicorrelated(("d", "e", "f"), rho),
    ]
    every = {name: np.array([p]) for name, p in marginals.items()}
    tree = series(*NAMES)
    for name in NAMES:
        others = {n: np.array([0.0]) for n in NAMES if n != name}
        assert analyse(name, marginals).probability == pytest.approx(marginals[name])
        # In a series with members that cannot fail, what is left is the member itself.
        if name in "def":
            alone = probability(tree, others | {name: every[name]}, groups)
            assert alone[0] == pytest.approx(marginals[name], abs=1e-10)
    both = probability(parallel("a", "b"), every, [CommonCause(("a", "b"), beta)])[0]
    common = beta * min(chances[:2])
    rest = np.prod([(p - common) / (1 - common) for p in chances[:2]]) if common < 1 else 0.0
    assert both == pytest.approx(common + (1 - common) * rest, abs=1e-12)


def test_the_beta_factor_of_equal_members_is_the_share_that_fails_together():
    p, beta = 1e-6, 0.1
    found = analyse(
        parallel("a", "b", "c"), dict.fromkeys("abc", p), [CommonCause(("a", "b", "c"), beta)]
    )
    assert found.probability == pytest.approx(beta * p, rel=1e-5)


SITE = series(
    parallel("p1", "p2", "p3"),
    k_of_n(2, "v1", "v2", "v3", "p1"),
    parallel(series("t1", "t2"), series("t3", "t2"), series("t4", "s1")),
    "s2",
)
SITE_CHANCES = dict(
    p1=0.21, p2=0.17, p3=0.3, v1=0.11, v2=0.09, v3=0.14,
    t1=0.2, t2=0.08, t3=0.25, t4=0.3, s1=0.05, s2=0.012,
)  # fmt: skip
DEPENDENCES: dict[str, tuple[Group, ...]] = {
    "independent": (),
    "common cause": (CommonCause(("p1", "p2", "p3"), 0.2), CommonCause(("v1", "v2"), 0.5)),
    "equicorrelated": (
        Equicorrelated(("p1", "p2", "v1", "t1"), 0.4),
        Equicorrelated(("t3", "t4"), 0.9),
    ),
    "both": (
        CommonCause(("p1", "t2", "s2"), 0.3),
        Equicorrelated(("v1", "v2", "v3", "t4"), 0.6),
    ),
}


@pytest.mark.parametrize("dependence", DEPENDENCES)
def test_a_site_of_twelve_with_shared_members_agrees_with_sampling(dependence):
    groups = DEPENDENCES[dependence]
    assert len(members(SITE)) == 12
    found = analyse(SITE, SITE_CHANCES, groups)
    estimate, sd = simulate(SITE, SITE_CHANCES, groups, np.random.default_rng(1), 400_000)
    assert abs(found.probability - estimate) < 4 * sd
    assert sd < 0.01 * estimate
    lo, hi = found.bounds
    assert lo <= found.probability <= hi
    if groups:
        alone = analyse(SITE, SITE_CHANCES).probability
        assert abs(found.probability - alone) > 8 * sd  # the dependence is seen


@pytest.mark.parametrize("dependence", DEPENDENCES)
def test_importances_under_dependence_agree_with_sampling(dependence):
    groups, rng, count = DEPENDENCES[dependence], np.random.default_rng(2), 200_000
    found = analyse(SITE, SITE_CHANCES, groups)
    each = trees.dependence.grouped(members(SITE), groups)
    failed = {n: d for g in each for n, d in g.draw(SITE_CHANCES, rng, count).items()}
    whole = fails(SITE, failed)
    for name in members(SITE):
        yes = fails(SITE, failed | {name: np.ones(count, dtype=bool)})
        no = fails(SITE, failed | {name: np.zeros(count, dtype=bool)})
        critical = np.mean(yes & ~no)
        one = found.importance[name]
        if not groups:
            assert one.birnbaum == pytest.approx(critical, abs=5 * math.sqrt(0.25 / count))
        share = np.mean(yes & ~no & failed[name]) / np.mean(whole)
        assert one.criticality == pytest.approx(share, abs=0.01)


@pytest.mark.parametrize("needed", [1, 2, 3, 4])
def test_the_bounds_of_a_gate_are_attained_by_some_dependence(needed):
    chances = np.array([0.1, 0.35, 0.6, 0.9])
    cases = np.array(list(itertools.product([0, 1], repeat=4)))
    constraints, values = np.vstack([cases.T, np.ones(16)]), [*chances, 1.0]
    goal = (cases.sum(axis=1) >= needed).astype(float)
    solved = [linprog(sign * goal, A_eq=constraints, b_eq=values).fun for sign in (1, -1)]
    found = np.array(solved, dtype=float) * (1, -1)
    marginals = dict(zip("abcd", chances.tolist(), strict=True))
    lo, hi = any_dependence(k_of_n(5 - needed, *"abcd"), marginals)
    assert (lo, hi) == pytest.approx(tuple(found), abs=1e-9)


def test_a_band_is_that_of_draws_and_within_the_ends_of_all_members():
    bands = {n: (p, 0.6 * p, 1.8 * p) for n, p in SITE_CHANCES.items()}
    groups = DEPENDENCES["both"]
    found = band(SITE, bands, np.random.default_rng(0), groups)
    assert found.lowest < found.lo < found.value < found.hi < found.highest
    assert found.value == pytest.approx(analyse(SITE, SITE_CHANCES, groups).probability)
    rng = np.random.default_rng(9)
    scores = np.abs(rng.standard_normal((12, 4000))), rng.random((12, 4000)) < 0.5
    drawn = {
        name: p + np.where(up, 0.8, -0.4) * p * score / 1.959964
        for (name, p), score, up in zip(SITE_CHANCES.items(), *scores, strict=True)
    }
    truth = np.quantile(
        probability(SITE, {n: np.clip(d, 0, 1) for n, d in drawn.items()}, groups),
        [0.025, 0.975],
    )
    assert (found.lo, found.hi) == pytest.approx(tuple(truth), rel=0.04)


def test_a_member_that_is_not_known_leaves_bounds_and_no_value():
    bands = {"a": (0.1, 0.1, 0.1), "b": (math.nan, 0.0, 1.0)}
    found = band(parallel("a", "b"), bands, np.random.default_rng(0))
    assert math.isnan(found.value)
    assert (found.lo, found.hi) == pytest.approx((0.0, 0.1))


def test_large_trees_of_like_assets_are_quick_and_tangled_ones_refused():
    names = [f"m{i}" for i in range(200)]
    rows = [k_of_n(8, *names[i : i + 10]) for i in range(0, 200, 10)]
    found = analyse(
        k_of_n(18, *rows), dict.fromkeys(names, 0.05), [Equicorrelated(tuple(names[:50]), 0.3)]
    )
    row = stats.binom.sf(2, 10, 0.05)
    assert found.probability > stats.binom.sf(2, 20, row)
    one = found.importance["m0"]
    assert math.isnan(one.fussell_vesely)  # 2e9 minimal cut sets and more
    assert one.criticality > found.importance["m199"].criticality  # its row fails together
    rng = np.random.default_rng(0)
    tangled = series(*(k_of_n(20, *rng.choice(names, 40, replace=False)) for _ in range(40)))
    with pytest.raises(trees.TooLargeTreeError, match="too entangled"):
        analyse(tangled, dict.fromkeys(names, 0.05))


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: series(), "no input"),
        (lambda: k_of_n(3, "a", "b"), "3 of 2 inputs were asked to work. Allowed: 1 to 2"),
        (lambda: CommonCause(("a", "b"), 1.5), "beta=1.5 is outside"),
        (lambda: Equicorrelated(("a", "b"), -0.2), "no negative correlation"),
        (lambda: Equicorrelated(("a",), 0.2), "at least two members"),
        (lambda: analyse("a", {}), "names a, whose failure probability was not given"),
        (lambda: analyse("a", {"a": 1.2}), "from 0 to 1"),
        (
            lambda: analyse("a", {"a": 0.2}, [CommonCause(("a", "z"), 0.1)]),
            "'z', which is not in",
        ),
        (
            lambda: analyse(
                series("a", "b", "c"),
                dict.fromkeys("abc", 0.1),
                [CommonCause(("a", "b"), 0.1), Equicorrelated(("b", "c"), 0.1)],
            ),
            "'b' is in two groups",
        ),
    ],
)
def test_what_is_wrong_is_named(make, says):
    with pytest.raises(ValueError, match=says):
        make()

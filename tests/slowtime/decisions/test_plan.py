import dataclasses

import numpy as np
import pytest

from slowtime.decisions import (
    ITEMS,
    Cost,
    Costs,
    Ensemble,
    EstimateError,
    Observation,
    Terms,
    age_policy,
    from_paths,
    make_plan,
)
from slowtime.decisions.continuation import follow_of, payments
from slowtime.decisions.rules import at_age, run_to_failure

TIME = np.linspace(0.0, 10.0, 121)
COSTS = Costs(
    failure=Cost(20.0, 2.0),
    repair=Cost(2.0, 0.2),
    inspection=Cost(0.05),
    downtime=Cost(1.0),
    closing=Cost(5.0),
    closed=Cost(3.0),
    failure_downtime=0.2,
    discount_rate=0.03,
)
TERMS = Terms(
    error=EstimateError(0.05, 1.0),
    inspection=Observation(name="ultrasound", sd=0.02),
    observations=(
        Observation(
            name="readings", kind="readings", count=6, every=1 / 12, sd=0.05, cost=0.01
        ),
        Observation(name="dye", kind="detection", half=0.6, slope=6.0, cost=0.02),
    ),
)


def futures(start=0.5, spread=0.08, paths=400, seed=1):
    rng = np.random.default_rng(seed)
    rate = 0.12 * np.exp(0.3 * rng.standard_normal((paths, 1)))
    steps = rng.gamma(rate * TIME[1] / 0.02, 0.02, (paths, len(TIME) - 1))
    grown = np.concatenate([np.zeros((paths, 1)), np.cumsum(steps, axis=1)], axis=1)
    new = from_paths(TIME, grown)
    now = start + spread * rng.standard_normal((paths, 1)) + grown

    def renewed(damage: float) -> Ensemble:
        return new if damage == 0.0 else from_paths(TIME, grown + damage)

    return from_paths(TIME, np.minimum(now, 5.0), renewed=renewed)


def exponential(rate, paths=4000):
    """Futures of a life that does not wear, by equally probable quantiles."""
    life = -np.log1p(-(np.arange(paths) + 0.5) / paths) / rate
    time = np.linspace(0.0, 10.0, 2001)
    damage = np.zeros((paths, len(time)))
    return Ensemble(
        time, damage, np.where(life <= 10.0, life, np.inf), np.full(paths, 1 / paths)
    )


def test_failures_at_random_cost_what_a_poisson_process_costs():
    of_life = exponential(0.4)
    costs = Costs(failure=Cost(3.0), repair=Cost(1.0), discount_rate=0.1)
    follow = follow_of(payments(run_to_failure(of_life), of_life, costs), None)
    exact = 3.0 * 0.4 * (1.0 - np.exp(-0.1 * 10.0)) / 0.1
    assert float(follow.new[-1] @ costs.prices()) == pytest.approx(exact, rel=0.01)


def test_an_age_policy_costs_its_renewal_reward_in_the_long_run():
    one = futures(start=0.0, spread=0.0)
    costs = Costs(failure=Cost(20.0), repair=Cost(2.0))
    survival = 1.0 - one.failure_probability()
    long_run = age_policy(TIME, survival, repair=2.0, failure=20.0).cost_rates[48]
    cycle = payments(at_age(one, 48), one, costs)
    pad = np.zeros((20 * 120, len(ITEMS)))
    padded = dataclasses.replace(
        cycle,
        items=np.vstack([cycle.items, pad]),
        new=np.append(cycle.new, pad[:, 0]),
        worn=np.append(cycle.worn, pad[:, 0]),
    )
    value = follow_of(padded, None).new @ costs.prices()
    rate = (value[-1] - value[-1201]) / 100.0
    # The chain counts a failure at the end of its step, the integral in between.
    assert rate == pytest.approx(long_run, rel=0.02)


def test_continuation_is_what_simulated_cycles_cost():
    """The renewal equation against cycles drawn one after the other."""
    one, costs = futures(start=0.0, spread=0.0), dataclasses.replace(COSTS, closing=None)
    rule = at_age(one, 75)  # some fail before
    value = float(follow_of(payments(rule, one, costs), None).new[-1] @ costs.prices())
    rng, totals = np.random.default_rng(2), []
    failure, repair = costs.price(0), costs.price(1)
    for _ in range(4000):
        at, total = 0, 0.0
        while True:
            path = rng.integers(len(one.weights))
            at += int(rule.end[path])
            if at >= len(TIME):
                break
            price = failure if rule.failed[path] else repair
            total += price * np.exp(-costs.discount_rate * TIME[at])
        totals.append(total)
    error = np.std(totals) / np.sqrt(len(totals))
    assert abs(np.mean(totals) - value) < 4 * error


@pytest.mark.parametrize("start", [0.1, 0.6, 0.85])
def test_options_end_their_curves_at_their_cost_and_come_in_order(start):
    plan = make_plan(futures(start), COSTS, TERMS)
    prices = COSTS.prices()
    assert np.all(np.diff(plan.costs) >= 0)
    for option, cost in zip(plan.options, plan.costs, strict=True):
        assert float(option.curve[-1] @ prices) == pytest.approx(cost, rel=1e-6)
        assert np.all(np.diff(option.curve @ prices) >= -1e-9)
    names = {option.name for option in plan.options}
    assert {
        "nothing", "age", "fixed_interval", "estimate_threshold", "periodic_inspection",
        "repair_now", "repair_at", "inspect_now", "inspect_at", "close",
    } <= names  # fmt: skip


def test_no_inspection_is_worth_less_than_nothing_and_none_beats_perfect_knowledge():
    for start in (0.2, 0.5, 0.7, 0.9):
        for one in make_plan(futures(start), COSTS, TERMS).worths:
            assert one.value >= -1e-9
            assert one.net <= one.value + 1e-9


def test_a_break_even_cost_makes_both_options_cost_the_same():
    plan = make_plan(futures(0.85), COSTS, TERMS)
    ranking = plan.ranking
    assert ranking.break_even
    assert ranking.other is not None
    weights = plan.futures.weights
    for one in ranking.break_even:
        changed = COSTS.with_price(ITEMS.index(one.item), one.at).prices()
        assert ranking.other is not None
        best, other = (
            float(plan.options[k].quantities(weights) @ changed)
            for k in (ranking.best, ranking.other)
        )
        assert best == pytest.approx(other, rel=1e-6)


def test_an_asset_that_is_about_to_fail_is_repaired_and_a_new_one_is_left():
    assert make_plan(futures(0.97, spread=0.02), COSTS, Terms()).best.now == "repair"
    assert make_plan(futures(0.0, spread=0.0), COSTS, TERMS).best.now == "wait"


def test_repairs_that_cost_as_much_as_failures_are_not_made():
    costs = Costs(failure=Cost(2.0), repair=Cost(2.0), discount_rate=0.05)
    assert make_plan(futures(0.8), costs, Terms()).best.name == "nothing"


def test_a_ranking_that_hangs_on_an_unknown_cost_is_not_known():
    known = dataclasses.replace(COSTS, closing=None)
    assert make_plan(futures(0.2), known, TERMS).ranking.is_known
    vague = dataclasses.replace(known, failure=Cost(20.0, 40.0), repair=Cost(2.0, 3.0))
    assert not make_plan(futures(0.85), vague, TERMS).ranking.is_known


def test_a_repair_that_restores_less_costs_more_in_the_end():
    costs = [
        float(
            make_plan(futures(0.7), COSTS, dataclasses.replace(TERMS, restored=share)).costs[0]
        )
        for share in (1.0, 0.8, 0.5)
    ]
    assert np.all(np.diff(costs) > 0)


def test_the_same_futures_make_the_same_plan():
    first, again = (make_plan(futures(0.6), COSTS, TERMS) for _ in range(2))
    np.testing.assert_array_equal(first.costs, again.costs)
    assert first.ranking == again.ranking


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"mean": -1.0}, "mean -1"),
        ({"mean": 0.0, "sd": 1.0}, "an sd only where"),
    ],
)
def test_costs_that_cannot_be_are_refused(given, text):
    with pytest.raises(ValueError, match=text):
        Cost(**given)


def test_an_uncertain_cost_keeps_its_mean_and_sd():
    drawn = Costs(failure=Cost(10.0, 4.0), repair=Cost(1.0)).draws(200_000)[:, 0]
    assert drawn.mean() == pytest.approx(10.0, rel=0.01)
    assert drawn.std() == pytest.approx(4.0, rel=0.02)

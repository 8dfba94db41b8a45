"""The last order against brute force over order dates, and against laws in closed form."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from slowtime.decisions import (
    Access,
    Cost,
    Costs,
    Ensemble,
    EstimateError,
    Observation,
    Terms,
    from_paths,
    make_plan,
)  # fmt: skip
from slowtime.decisions.lead_times import last_order_by_probability

TIME = np.linspace(0.0, 10.0, 121)
SEASONS = tuple((year + 0.3, year + 0.7) for year in range(12))
COSTS = Costs(failure=Cost(20.0), repair=Cost(2.0), discount_rate=0.04)
ACCESSES = [
    Access(),
    Access(lead=1.7),
    Access(windows=SEASONS),
    Access(lead=1.7, windows=SEASONS),
    Access(lead=0.01, windows=((2.0, 2.01), (6.0, 6.01))),
]


def futures(start=0.3, paths=600, seed=1):
    """Futures after whose repair nothing fails any more."""
    rng = np.random.default_rng(seed)
    rate = 0.12 * np.exp(0.3 * rng.standard_normal((paths, 1)))
    steps = rng.gamma(rate * TIME[1] / 0.02, 0.02, (paths, len(TIME) - 1))
    grown = np.concatenate([np.zeros((paths, 1)), np.cumsum(steps, axis=1)], axis=1)
    new = from_paths(TIME, np.zeros((2, len(TIME))))
    return from_paths(TIME, np.minimum(start + grown, 5.0), renewed=lambda _: new)


def brute_cost(one: Ensemble, effect: float) -> float:
    """Mean cost of a repair that takes effect at a time, path by path."""
    total = 0.0
    for fails in one.failure_time:
        # The plan counts a failure at the end of its step, and so before a repair there.
        step = np.ceil(fails / TIME[1] - 1e-9) * TIME[1]
        if step <= effect + 1e-9:
            total += 20.0 * np.exp(-0.04 * step)
        elif np.isfinite(effect):
            total += 2.0 * np.exp(-0.04 * effect)
    return total / len(one.failure_time)


@pytest.mark.parametrize("access", ACCESSES)
@pytest.mark.parametrize("limit", [0.01, 0.1, 0.4])
def test_by_probability_no_later_order_is_safe_and_this_one_is(access, limit):
    one = futures()
    found = last_order_by_probability(one.failure_time, one.weights, access, limit)
    orders = np.arange(-access.lead - 0.5, 10.0, 0.01)
    effects = np.array([access.effect(order) for order in orders])
    chances = np.array([np.mean(one.failure_time < effect) for effect in effects])
    safe = orders[chances <= limit]
    # A window may close before its last order would take effect: the date is of that closing.
    brute = max(effects[chances <= limit]) if len(safe) else -np.inf
    assert found.effect == pytest.approx(brute, abs=0.011)
    assert found.order == pytest.approx(found.effect - access.lead)
    assert found.probability <= limit
    assert found.low <= found.order <= found.high


def test_by_probability_it_is_the_quantile_of_a_wiener_process_less_the_lead_time():
    rate, spread, damage, limit, lead = 0.1, 0.08, 0.4, 0.05, 1.2
    away = 1.0 - damage
    law = stats.invgauss(spread**2 / (rate * away), scale=away**2 / spread**2)
    exact = float(law.ppf(limit)) - lead
    held = 0
    for seed in range(40):
        times = law.rvs(2000, random_state=np.random.default_rng(seed))
        found = last_order_by_probability(
            times, np.full(2000, 1 / 2000), Access(lead=lead), limit
        )
        assert found.order == pytest.approx(exact, rel=0.1)
        held += found.low <= exact <= found.high
    assert 32 <= held <= 40  # 90 % of 40, within three standard deviations


@pytest.mark.parametrize("access", ACCESSES)
def test_by_cost_and_as_an_option_it_is_the_best_of_all_dates_by_brute_force(access):
    one = futures()
    plan = make_plan(one, COSTS, Terms(access=access))
    at = access.effect_times(TIME)
    costs = {k: brute_cost(one, TIME[k]) for k in np.flatnonzero(np.isfinite(at))}
    by_name = {option.name: option for option in plan.options}
    now = int(access.effect_index(TIME)[0])
    later = {k: cost for k, cost in costs.items() if k > now}
    best = min(later, key=lambda k: later[k])
    option = by_name["repair_at"]
    assert option.parameters["at"] == pytest.approx(at[best])
    assert option.parameters["order"] == pytest.approx(at[best] - access.lead)
    prices = COSTS.prices()
    told = {name: float(one.weights @ (o.items @ prices)) for name, o in by_name.items()}
    assert told["repair_at"] == pytest.approx(later[best], rel=1e-9)
    if now < len(TIME):
        assert told["repair_now"] == pytest.approx(brute_cost(one, TIME[now]), rel=1e-9)
    free = {k: brute_cost(one, TIME[k]) for k in np.flatnonzero(
        np.isfinite(access.effect_times(TIME, lead=False)))}  # fmt: skip
    first = min(free, key=lambda k: free[k])
    effect = access.effect_times(TIME, lead=False)[first]
    assert plan.last_order.by == "cost"
    assert plan.last_order.order == pytest.approx(effect - access.lead)


def test_a_threshold_that_is_reached_orders_and_the_repair_follows_later():
    one, lead = futures(), 1.5
    plan = make_plan(one, COSTS, Terms(access=Access(lead=lead)))
    (option,) = (o for o in plan.options if o.name == "estimate_threshold")
    level = option.parameters["damage"]
    total = 0.0
    for path, fails in zip(one.damage, one.failure_time, strict=True):
        reached = TIME[np.argmax(path >= level)] if (path >= level).any() else np.inf
        effect = np.ceil((reached + lead) / TIME[1] - 1e-9) * TIME[1]
        step = np.ceil(fails / TIME[1] - 1e-9) * TIME[1]
        if min(step, effect) <= TIME[-1] + 1e-9:
            failed = step <= effect + 1e-9
            total += (20.0 if failed else 2.0) * np.exp(-0.04 * min(step, effect))
    cost = float(one.weights @ (option.items @ COSTS.prices()))
    assert cost == pytest.approx(total / len(one.damage), rel=1e-9)


def test_a_longer_lead_time_never_allows_a_later_order_and_costs_no_less():
    one, dates, costs = futures(), [], []
    for lead in (0.0, 0.4, 1.1, 2.5, 4.0, 7.0):
        terms = [Terms(access=Access(lead=lead), accepted=p) for p in (0.02, None)]
        plans = [make_plan(one, COSTS, each) for each in terms]
        dates.append([plan.last_order.order for plan in plans])
        costs.append(float(plans[0].costs[0]))
    assert np.all(np.diff(dates, axis=0) < 0.0)
    assert np.all(np.diff(costs) >= -1e-9)


def test_a_smaller_accepted_probability_never_allows_a_later_order():
    one = futures()
    orders = [
        last_order_by_probability(one.failure_time, one.weights, Access(lead=0.5), p).order
        for p in (0.3, 0.1, 0.03, 0.01, 0.003)
    ]
    assert np.all(np.diff(orders) <= 0.0)


@pytest.mark.parametrize("start", [0.1, 0.5, 0.8])
def test_every_planned_repair_falls_into_a_window(start):
    plan = make_plan(futures(start), COSTS, Terms(access=Access(lead=0.6, windows=SEASONS)))
    for option in plan.options:
        if option.name in ("repair_now", "repair_at"):
            assert 0.3 <= option.parameters["at"] % 1.0 <= 0.7
    if np.isfinite(plan.last_order.effect):
        assert 0.3 <= plan.last_order.effect % 1.0 <= 0.7


def test_always_open_without_lead_time_is_as_if_access_were_not_asked():
    one = futures()
    first = make_plan(one, COSTS, Terms())
    again = make_plan(one, COSTS, Terms(access=Access(windows=((0.0, 1e6),))))
    np.testing.assert_allclose(first.costs, again.costs, rtol=1e-12)


def test_where_nothing_fails_no_order_is_due_and_where_all_fail_it_has_passed():
    none = last_order_by_probability(
        np.full(100, np.inf), np.full(100, 0.01), Access(lead=1.0), 0.1
    )
    assert (none.order, none.probability) == (np.inf, 0.0)
    soon = last_order_by_probability(
        np.linspace(0.1, 0.9, 100), np.full(100, 0.01), Access(lead=1.0), 0.1
    )
    assert soon.order < 0.0
    assert soon.now_probability == pytest.approx(1.0)


def test_an_accepted_probability_that_is_none_is_refused():
    with pytest.raises(ValueError, match="between 0 and 1"):
        last_order_by_probability(np.ones(2), np.full(2, 0.5), Access(), 2.0)


def test_readings_that_come_anyway_are_awaited_where_they_tell_who_needs_a_repair():
    """One half of the futures fails, the other never does, and their rates soon tell which."""
    new = from_paths(TIME, np.zeros((2, len(TIME))))
    rates = np.where(np.arange(400) % 2 == 0, 0.16, 0.0)[:, None]
    one = from_paths(TIME, 0.2 + rates * TIME, renewed=lambda _: new)
    more = Observation(name="readings", kind="readings", sd=0.005, count=12, every=1 / 12)
    # By an estimate without an error, a threshold would tell the futures apart as well.
    error = EstimateError(0.2, 1.0)
    terms = Terms(access=Access(lead=1.0), observations=(more,), error=error)
    costs = Costs(failure=Cost(20.0), repair=Cost(2.0))
    plan = make_plan(one, costs, terms)
    (option,) = (o for o in plan.options if o.name == "read_on")
    # Who sees which future it is repairs one half of them, for 2 each.
    assert float(one.weights @ (option.items @ costs.prices())) == pytest.approx(1.0, rel=1e-6)
    assert option.parameters["at"] == pytest.approx(1.0)
    blind = make_plan(one, costs, dataclasses.replace(terms, observations=()))
    assert {o.name for o in blind.options} == {o.name for o in plan.options} - {"read_on"}


def test_readings_end_by_the_last_order_and_are_no_option_where_they_save_nothing():
    new = from_paths(TIME, np.zeros((2, len(TIME))))
    rates = np.where(np.arange(400) % 2 == 0, 0.16, 0.0)[:, None]
    one = from_paths(TIME, 0.2 + rates * TIME, renewed=lambda _: new)
    late = Observation(name="readings", kind="readings", sd=0.005, count=60, every=1 / 12)
    costs = Costs(failure=Cost(20.0), repair=Cost(2.0))
    error = EstimateError(0.2, 1.0)
    terms = Terms(access=Access(lead=1.0), observations=(late,), error=error)
    plan = make_plan(one, costs, terms)
    assert 1.0 < plan.last_order.order < 5.0
    (option,) = (o for o in plan.options if o.name == "read_on")
    assert option.parameters["at"] <= plan.last_order.order + 1e-9
    assert option.parameters["at"] > plan.last_order.order - 0.2
    # All futures are the same: readings tell nothing.
    same = from_paths(TIME, 0.2 + np.full((400, 1), 0.16) * TIME, renewed=lambda _: new)
    assert "read_on" not in {o.name for o in make_plan(same, costs, terms).options}


def test_a_threshold_that_orders_in_every_future_that_is_left_orders_now():
    """Where the estimate is about at the threshold, most futures count as failed already."""
    one = futures(start=0.97)
    failed = np.arange(len(one.damage)) % 4 > 0
    damage = one.damage + np.where(failed, 0.05, 0.0)[:, None]
    most = from_paths(TIME, damage, renewed=one.renewed)
    assert float(np.mean(most.failure_time == 0.0)) == pytest.approx(0.75)
    plan = make_plan(most, COSTS, Terms(access=Access(lead=0.5)))
    (option,) = (o for o in plan.options if o.name == "estimate_threshold")
    assert option.now == "repair"


@pytest.mark.parametrize("access", [Access(lead=1.0), Access(lead=0.2, windows=SEASONS)])
def test_closing_until_the_first_possible_repair_is_an_option_with_cost_and_risk(access):
    """By hand: nothing fails while closed, and after the repair of these futures neither."""
    costs = dataclasses.replace(COSTS, closing=Cost(0.5), closed=Cost(0.3))
    one = futures(start=0.9, paths=50)
    failed = np.arange(50) < 5  # by now
    one = dataclasses.replace(one, failure_time=np.where(failed, 0.0, one.failure_time))
    plan = make_plan(one, costs, Terms(access=access))
    by_name = {option.name: k for k, option in enumerate(plan.options)}
    option = plan.options[by_name["close_until_repair"]]
    effect = option.parameters["at"]
    assert effect == pytest.approx(access.effect(0.0))
    at = TIME[np.searchsorted(TIME, effect - 1e-9)]
    closed = 0.3 * (1 - np.exp(-0.04 * at)) / 0.04
    kept = 0.5 + closed + 2.0 * np.exp(-0.04 * at)
    assert plan.costs[by_name["close_until_repair"]] == pytest.approx(
        0.1 * 20.0 + 0.9 * kept, rel=1e-5
    )
    assert option.now == "close"
    failures = [
        each.quantities(one.weights)[0]
        for each in (option, plan.options[by_name["repair_now"]])
    ]
    assert failures[0] == pytest.approx(0.1)
    assert failures[1] > 0.11


def test_closing_until_a_repair_needs_a_price_of_closing_and_a_repair_that_takes_time():
    priced = dataclasses.replace(COSTS, closing=Cost(0.5), closed=Cost(0.3))
    for costs, access in (
        (COSTS, Access(lead=1.0)),
        (priced, Access()),
        (priced, Access(lead=20.0)),
    ):
        names = {one.name for one in make_plan(futures(), costs, Terms(access=access)).options}
        assert "close_until_repair" not in names
        assert ("close" in names) == (costs is priced)

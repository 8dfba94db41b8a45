import itertools

import numpy as np
import pytest

from slowtime.decisions import Cost, Costs, EstimateError, drift, fleet, look_ahead
from slowtime.decisions.lookahead import Monitored, repair_items

COSTS = Costs(failure=Cost(20.0), repair=Cost(1.0), inspection=Cost(0.03), discount_rate=0.03)
STEP = 1 / 12


def known(places, sd=0.03, rate=0.1):
    count = len(places)
    return drift.Pooled(
        np.asarray(places), np.full(count, rate), np.full(count, sd**2), np.zeros(count),
        np.full(count, 1e-5), np.array(0.002), np.array(0.0), np.array(0.1), np.array(0.03),
    )  # fmt: skip


@pytest.fixture(scope="module")
def follow():
    return fleet.continuations(
        COSTS, mean_rate=0.1, variance=0.002, epochs=120, step=STEP,
        error=EstimateError(0.03, 0.5),
    )  # fmt: skip


def test_the_more_damage_the_sooner_the_repair(follow):
    found = fleet.decide(
        known(np.linspace(0.0, 0.99, 40)), COSTS, follow, epochs=120, step=STEP
    )
    assert not found.repair[0]
    assert found.repair[-1]
    assert np.all(np.diff(found.repair.astype(int)) >= 0)


def test_an_inspection_is_ordered_only_where_it_may_change_the_decision(follow):
    found = fleet.decide(
        known(np.linspace(0.0, 0.99, 40), sd=0.08), COSTS, follow, epochs=120, step=STEP,
        inspection_sd=0.01,
    )  # fmt: skip
    assert found.inspect.any()
    assert not found.inspect[0]
    assert np.all(found.net_value[found.inspect] > 0.0)


def test_waiting_for_free_readings_never_costs_more(follow):
    places = known(np.linspace(0.5, 0.95, 20), sd=0.06)
    without = fleet.decide(places, COSTS, follow, epochs=120, step=STEP)
    told = fleet.decide(places, COSTS, follow, epochs=120, step=STEP, reading_sd=0.05)
    assert np.all(told.wait_cost <= without.wait_cost + 1e-12)


def test_a_faster_asset_costs_more_from_now_on(follow):
    values = follow.value[:, -1] @ COSTS.prices()
    assert np.all(np.diff(values) > 0)
    between = follow.at(np.array([0.07, 0.1]), np.array([120]))[:, 0] @ COSTS.prices()
    np.testing.assert_allclose(between, values[1:3], rtol=1e-9)


def test_repairing_at_a_time_costs_what_its_definition_says():
    time = np.array([0.0, 1.0, 2.0])
    cdf = np.array([[0.0, 0.2, 0.7]])
    none = np.zeros((1, 3, 6))
    cost = repair_items(time, cdf, COSTS, none, none)[0] @ COSTS.prices()
    weight = np.exp(-0.03 * time)
    exact = [1.0, 20 * 0.2 * weight[1] + 0.8 * weight[1]]
    exact.append(20 * (0.2 * weight[1] + 0.5 * weight[2]) + 0.3 * weight[2])
    np.testing.assert_allclose(cost, exact)


def test_an_observation_that_tells_nothing_changes_nothing():
    cost = np.random.default_rng(0).uniform(0, 3, (5, 7, 4))
    weights, damage = np.full((5, 7), 1 / 7), np.tile(np.linspace(0, 1, 7), (5, 1))
    plain = look_ahead(cost, weights)
    vague = look_ahead(
        cost, weights, damage, inspection_sd=1e6, inspection_cost=0.1,
        monitored=[Monitored(1, np.full(5, 1e6))],
    )  # fmt: skip
    np.testing.assert_array_equal(plain.repair, vague.repair)
    assert not vague.inspect.any()


def test_teams_go_where_their_total_net_value_is_largest():
    rng = np.random.default_rng(1)
    for _ in range(50):
        values, prices = rng.normal(1.0, 1.0, 8), rng.uniform(0.5, 2.0, 8)
        candidates = [
            fleet.VisitCandidate(f"a{k}", float(values[k]), float(prices[k])) for k in range(8)
        ]
        free = fleet.dispatch(candidates, 3)
        exact = sum(sorted((v for v in values if v > 0), reverse=True)[:3])
        assert sum(one.net_value for one in free) == pytest.approx(exact)
        limited = fleet.dispatch(candidates, 3, budget=3.0)
        assert sum(one.cost for one in limited) <= 3.0
        best = max(
            sum(values[k] for k in chosen)
            for size in range(4)
            for chosen in itertools.combinations(range(8), size)
            if sum(prices[k] for k in chosen) <= 3.0
        )
        assert sum(one.net_value for one in limited) >= 0.5 * best - 1e-9

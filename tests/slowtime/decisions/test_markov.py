import itertools

import numpy as np
import pytest

from slowtime.decisions import MarkovDecisionProcess, solve_beliefs, value_iteration

KEEP, REPAIR = 0, 1
WEAR = np.array([[0.8, 0.15, 0.05], [0.0, 0.7, 0.3], [0.0, 0.0, 1.0]])
AS_NEW = np.tile([1.0, 0.0, 0.0], (3, 1))
COST = np.array([[0.0, 2.0], [0.0, 2.0], [5.0, 7.0]])
CHAIN = MarkovDecisionProcess(COST, np.stack([WEAR, AS_NEW]), 0.95)


def by_policies(process):
    """Solve every policy as a linear system, and take the best of them."""
    states, actions = process.cost.shape
    best = np.full(states, np.inf)
    for policy in itertools.product(range(actions), repeat=states):
        rows = np.arange(states)
        transition = process.transition[list(policy), rows]
        cost = process.cost[rows, list(policy)]
        value = np.linalg.solve(np.eye(states) - process.discount * transition, cost)
        best = np.minimum(best, value)
    return best


def test_a_chain_of_three_states_is_solved_exactly():
    found = value_iteration(CHAIN)
    np.testing.assert_allclose(found.value, by_policies(CHAIN), rtol=1e-6)
    assert found.action.tolist() == [KEEP, REPAIR, REPAIR]


def test_random_chains_are_solved_exactly():
    rng = np.random.default_rng(3)
    for _ in range(20):
        process = MarkovDecisionProcess(
            rng.uniform(0, 10, (3, 3)),
            rng.dirichlet(np.ones(3), (3, 3)),
            rng.uniform(0.5, 0.98),
        )
        np.testing.assert_allclose(
            value_iteration(process).value, by_policies(process), rtol=1e-6
        )


def test_beliefs_with_a_seen_state_cost_what_the_seen_chain_costs():
    seen = MarkovDecisionProcess(COST, CHAIN.transition, 0.95, np.tile(np.eye(3), (2, 1, 1)))
    solution, exact = solve_beliefs(seen, steps=6), by_policies(CHAIN)
    for state in range(3):
        assert solution.value(np.eye(3)[state]) == pytest.approx(exact[state], rel=1e-4)


def blind_cost(belief, steps):
    """Least cost of a plan without looking: every sequence of actions, by brute force."""
    best = np.inf
    for plan in itertools.product((KEEP, REPAIR), repeat=steps):
        total, now = 0.0, belief
        for k, action in enumerate(plan):
            total += 0.6**k * now @ COST[:, action]
            now = now @ CHAIN.transition[action]
        best = min(best, total)
    return best


def test_beliefs_without_a_look_cost_what_the_best_sequence_costs():
    blind = MarkovDecisionProcess(COST, CHAIN.transition, 0.6, np.ones((2, 3, 1)))
    solution = solve_beliefs(blind, steps=26)
    for belief in ([1.0, 0.0, 0.0], [0.2, 0.5, 0.3], [0.0, 0.0, 1.0]):
        exact = blind_cost(np.array(belief), 13)  # what follows counts 0.6^13 = 0.1 %
        assert solution.value(np.array(belief)) == pytest.approx(exact, rel=0.01)


def test_a_better_look_costs_less_and_stays_between_blind_and_seen():
    start, costs = np.array([1.0, 0.0, 0.0]), []
    for error in (0.0, 0.1, 0.3, 2.0 / 3.0):
        look = (1 - error) * np.eye(3) + error / 2 * (1 - np.eye(3))
        process = MarkovDecisionProcess(COST, CHAIN.transition, 0.9, np.tile(look, (2, 1, 1)))
        costs.append(solve_beliefs(process, steps=10).value(start))
    assert np.all(np.diff(costs) > 0)


def test_rows_that_are_no_probabilities_are_refused():
    with pytest.raises(ValueError, match=r"Row \[1, 0\] of transition, .* sums to 0.5, not 1"):
        MarkovDecisionProcess(COST, np.stack([WEAR, AS_NEW * 0.5]), 0.9)

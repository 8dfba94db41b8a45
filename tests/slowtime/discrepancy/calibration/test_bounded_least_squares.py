"""Least squares within bounds: the conditions of an optimum, over random problems."""

import numpy as np
import pytest
import scipy.optimize

from slowtime.discrepancy.calibration.bounded_least_squares import solve_within


def problem(rng, size):
    """A positive definite matrix whose scales span six decades, a right side, and bounds."""
    scale = 10.0 ** rng.uniform(-3, 3, size)
    factor = rng.standard_normal((size + 3, size)) * scale
    matrix, right = factor.T @ factor, factor.T @ rng.standard_normal(size + 3)
    low, high = -rng.exponential(1, size) / scale, rng.exponential(1, size) / scale
    low[rng.random(size) < 0.3], high[rng.random(size) < 0.3] = -np.inf, np.inf
    return factor, matrix, right, low, high


@pytest.mark.parametrize("size", [1, 2, 7, 40])
def test_gradients_point_outwards_at_bounds_and_vanish_between(size):
    rng = np.random.default_rng(size)
    for _ in range(50):
        _, matrix, right, low, high = problem(rng, size)
        x = solve_within(matrix, right, low, high)
        assert (x >= low).all()
        assert (x <= high).all()
        gradient = (matrix @ x - right) / np.sqrt(np.diag(matrix))
        size_of = np.linalg.norm(right / np.sqrt(np.diag(matrix)))
        inside = (x > low) & (x < high)
        assert np.abs(gradient[inside]).max(initial=0.0) < 1e-7 * size_of
        assert gradient[x == low].min(initial=0.0) > -1e-7 * size_of
        assert gradient[x == high].max(initial=0.0) < 1e-7 * size_of


def test_solutions_are_those_of_another_solver():
    rng = np.random.default_rng(3)
    for _ in range(20):
        factor, matrix, right, low, high = problem(rng, 6)
        target = np.linalg.lstsq(factor.T, right, rcond=None)[0]
        other = scipy.optimize.lsq_linear(factor, target, (low, high), method="bvls").x
        cost = [0.5 * x @ matrix @ x - right @ x
                for x in (solve_within(matrix, right, low, high), other)]  # fmt: skip
        assert cost[0] <= cost[1] + 1e-9 * abs(cost[1])


def test_matrices_that_are_not_positive_definite_are_refused():
    far = np.full(2, np.inf)
    with pytest.raises(np.linalg.LinAlgError):
        solve_within(np.array([[1.0, 2.0], [2.0, 1.0]]), np.ones(2), -far, far)

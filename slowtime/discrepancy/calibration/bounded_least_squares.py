"""Least squares within bounds, by block pivoting on the normal equations."""

import numpy as np
import scipy.linalg
from jaxtyping import Float

PATIENCE = 3
"""[steps] Without fewer violations, after which only one variable changes sides at a time.
Source: Júdice and Pires, Computers & Operations Research 21 (1994), who take up to 10."""

MAX_PIVOTS = 500
"""[steps] Before the solution is given up. Source: problems of a hundred unknowns take about
five; half and double change no answer of docs/what_decides.md."""


def solve_within(
    matrix: Float[np.ndarray, "unknown unknown"],
    right: Float[np.ndarray, " unknown"],
    low: Float[np.ndarray, " unknown"],
    high: Float[np.ndarray, " unknown"],
) -> Float[np.ndarray, " unknown"]:
    r"""Minimise :math:`\tfrac12 x^T A x - b^T x` within bounds.

    All unknowns beyond a bound are put on it at once, and all whose gradient points inside are
    set free at once (block principal pivoting; Júdice and Pires 1994), which ends at the one
    solution of a positive definite matrix.

    Examples
    --------
    >>> far = np.array([np.inf, np.inf])
    >>> solve_within(np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([3.0, 0.0]), -far, far)
    array([ 2., -1.])
    >>> solve_within(np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([3.0, 0.0]), np.zeros(2), far)
    array([1.5, 0. ])
    """
    side = np.zeros(len(right), dtype=np.int64)  # -1 at the lower bound, 1 at the upper
    fewest, patience = len(right) + 1, PATIENCE
    for _ in range(MAX_PIVOTS):
        x = _solution(matrix, right, np.where(side < 0, low, high), side == 0)
        wanted = _sides(matrix @ x - right, x, low, high, side)
        wrong = np.flatnonzero(wanted != side)
        if len(wrong) == 0:
            return x
        if len(wrong) < fewest:
            fewest, patience = len(wrong), PATIENCE
        else:
            patience -= 1
        # The last alone, once blocks go round in circles: this cannot.
        changed = wrong if patience >= 0 else wrong[-1:]
        side[changed] = wanted[changed]
    raise np.linalg.LinAlgError(f"No solution within bounds in {MAX_PIVOTS} steps.")


def _solution(
    matrix: Float[np.ndarray, "unknown unknown"],
    right: Float[np.ndarray, " unknown"],
    bound: Float[np.ndarray, " unknown"],
    free: np.ndarray,
) -> Float[np.ndarray, " unknown"]:
    """Solve for what is free, the rest being at its bounds."""
    held = ~free
    x = np.where(held, bound, 0.0)
    if free.any():
        pushed = right[free] - matrix[np.ix_(free, held)] @ x[held]
        factor = scipy.linalg.cho_factor(matrix[np.ix_(free, free)], lower=True)
        x[free] = scipy.linalg.cho_solve(factor, pushed)
    return x


def _sides(
    gradient: Float[np.ndarray, " unknown"],
    x: Float[np.ndarray, " unknown"],
    low: Float[np.ndarray, " unknown"],
    high: Float[np.ndarray, " unknown"],
    side: np.ndarray,
) -> np.ndarray:
    """Say at which bound each unknown should be, by its value or the gradient there."""
    wanted = side.copy()
    wanted[(side == 0) & (x < low)] = -1
    wanted[(side == 0) & (x > high)] = 1
    inward = np.where(side < 0, gradient < 0, gradient > 0)
    wanted[(side != 0) & inward] = 0
    return wanted

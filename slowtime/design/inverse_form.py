r"""Inverse first-order reliability: the worst value of a limit state at a given distance.

.. math:: \min_u g(d, T(u)) \quad \text{subject to} \quad \lVert u \rVert = \beta

Where the minimum is 0, the first-order probability of failure is :math:`\Phi(-\beta)`.

References
----------
.. [1] J. Tu, K. K. Choi and Y. H. Park, "A new study on reliability-based design optimization",
   J. Mech. Des. 121 (1999) 557-564: the performance measure approach.
"""

import numpy as np
from jaxtyping import Float

from slowtime.reliability import Evaluator, Problem

STARTS = 12
"""Random directions that are descended from, beside the ones that are given."""

STEPS = 60
"""Steps along the sphere at most."""

DIFFERENCE = 1e-5
"""Step of the finite differences, in standard normal space."""

ALIKE = 0.05
"""Angle [rad] within which two minima are the same."""

TOLERANCE = 1e-7
"""Angle [rad] of the last step."""

NEAR = 3.0
"""Minima whose value lies above the least by more than this many spreads of g over the sphere
(its gradient times beta) are left out: they do not bind before the least does."""


def worst_points(
    problem: Problem,
    beta: float,
    rng: np.random.Generator,
    known: Float[np.ndarray, "start input"] | None = None,
) -> tuple[Float[np.ndarray, "point input"], Float[np.ndarray, " point"]]:
    """Minima of the limit state over the sphere of radius `beta`, the lowest first.

    Projected gradient descent with a step that is halved until g falls, from all starts at
    once.

    Parameters
    ----------
    problem
        Its limit state is evaluated; calls are batched over the starts.
    beta
        Distance from the origin in standard normal space.
    rng
        Generator of the starts.
    known
        Points of an earlier search, in standard normal space, as further starts.

    Returns
    -------
    Points of the sphere in standard normal space, and the limit state there.
    """
    size = problem.size
    evaluate = Evaluator(problem)
    if beta <= 0.0:
        origin = np.zeros((1, size))
        return origin, evaluate(origin)
    ways = [rng.standard_normal((STARTS, size))]
    downhill = -_gradient(evaluate, np.zeros((1, size)), evaluate(np.zeros((1, size))))
    ways += [downhill] if np.any(downhill) else []
    ways += [known] if known is not None and len(known) else []
    u = beta * _unit(np.concatenate(ways))
    g = evaluate(u)
    step = np.full(len(u), 0.5)
    for _ in range(STEPS):
        slope = _gradient(evaluate, u, g)
        along = slope - (slope * u).sum(axis=1, keepdims=True) / beta**2 * u
        size_of = np.linalg.norm(along, axis=1)
        moving = (step > TOLERANCE) & (size_of > 0.0)
        if not moving.any():
            break
        way = -along / np.where(size_of > 0.0, size_of, 1.0)[:, None]
        # The minimum over the sphere of a plane lies along minus its gradient: the angle to it.
        full = np.arctan2(size_of, -(slope * u).sum(axis=1) / beta)
        angle = np.minimum(full, step)
        tried = np.cos(angle)[:, None] * u + beta * np.sin(angle)[:, None] * way
        value = evaluate(tried)
        better = (value < g) & moving
        u, g = np.where(better[:, None], tried, u), np.where(better, value, g)
        step = np.where(better, np.minimum(2.0 * step, np.pi), 0.3 * angle)
    return _distinct(u, g, beta, _gradient(evaluate, u, g))


def _gradient(
    evaluate: Evaluator, u: np.ndarray, g: np.ndarray
) -> Float[np.ndarray, "point input"]:
    count, size = u.shape
    moved = u[:, None, :] + DIFFERENCE * np.eye(size)
    back = u[:, None, :] - DIFFERENCE * np.eye(size)
    values = evaluate(np.concatenate([moved, back]).reshape(-1, size))
    up, down = values.reshape(2, count, size)
    central = (up - down) / (2.0 * DIFFERENCE)
    return np.where(np.isfinite(central), central, np.nan_to_num(g[:, None] * 0.0))


def _unit(vectors: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(lengths > 0.0, lengths, 1.0))


def _distinct(
    u: np.ndarray, g: np.ndarray, beta: float, slope: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    order = np.argsort(g, kind="stable")
    kept: list[int] = []
    reach = NEAR * beta * float(np.linalg.norm(slope[order[0]])) + 1e-12
    for k in order.tolist():
        cosines = [float(u[k] @ u[j]) / beta**2 for j in kept]
        if all(c < np.cos(ALIKE) for c in cosines) and g[k] - g[order[0]] <= reach:
            kept.append(k)
    return u[kept], g[kept]

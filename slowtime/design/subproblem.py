"""The deterministic problem between two searches for worst points: a smooth programme."""

import dataclasses
from collections.abc import Callable

import numpy as np
import scipy
from jaxtyping import Float
from scipy.optimize import minimize

DIFFERENCE = 1e-5
"""Step of the finite differences, over the width of the bounds."""

STARTS = 6
"""Sobol points of the box that are descended from, beside the design in hand."""

VIOLATION = 1e-6
"""Scaled limit state below 0 that still counts as met."""

Batch = Callable[[np.ndarray], np.ndarray]


@dataclasses.dataclass(frozen=True, slots=True)
class Programme:
    """Minimise `objective` where all `margins` are at least 0, within the unit box.

    Parameters
    ----------
    objective
        From designs in the unit box [design variable] to values [design].
    margins
        To scaled limit states [design margin].
    """

    objective: Batch
    margins: Batch


def solve(
    programme: Programme, start: Float[np.ndarray, " variable"], seed: int, *, wide: bool
) -> tuple[Float[np.ndarray, " variable"], float]:
    """Best point of the box, and its largest violation (0 where every margin is met).

    Sequential quadratic programming (SLSQP) with batched finite differences, from the design
    in hand and, where `wide`, from Sobol points. Where no start ends feasible, the point of
    the least violation.

    Parameters
    ----------
    programme
        Objective and margins over the unit box.
    start
        Point to start from, in the unit box [1].
    seed
        Seed of the further starts.
    wide
        Whether to start from Sobol points as well.

    Returns
    -------
    Point in the unit box [1], and its largest violation [1].
    """
    size = len(start)
    starts = [np.clip(start, 0.0, 1.0)]
    if wide:
        sobol = scipy.stats.qmc.Sobol(size, rng=np.random.default_rng(seed))
        starts += list(sobol.random(8)[:STARTS])
    ended = [_descend(programme, one) for one in starts]
    ended += [starts[0]]
    points = np.array(ended)
    violation = np.maximum(-programme.margins(points).min(axis=1, initial=np.inf), 0.0)
    violation = np.where(np.isfinite(violation), violation, 0.0)
    met = violation <= VIOLATION
    if met.any():
        value = np.where(met, programme.objective(points), np.inf)
        best = int(np.argmin(value))
        return points[best], 0.0
    least = np.array([_least_violation(programme, one) for one in points])
    violation = np.maximum(-programme.margins(least).min(axis=1), 0.0)
    best = int(np.argmin(violation))
    return least[best], float(violation[best] if violation[best] > VIOLATION else 0.0)


def _descend(programme: Programme, start: np.ndarray) -> np.ndarray:
    size = len(start)
    scale = max(abs(float(programme.objective(start[None])[0])), 1e-12)

    def value(s: np.ndarray) -> tuple[float, np.ndarray]:
        values, slopes = _slopes(lambda d: programme.objective(d)[:, None], s)
        return float(values[0]) / scale, slopes[0] / scale

    count = programme.margins(start[None]).shape[1]
    constraint = {
        "type": "ineq",
        "fun": lambda s: programme.margins(np.clip(s, 0.0, 1.0)[None])[0],
        "jac": lambda s: _slopes(programme.margins, s)[1],
    }
    found = minimize(  # type: ignore[call-overload]  # scipy-stubs: no dicts of callables
        value,
        start,
        jac=True,
        method="SLSQP",
        bounds=[(0.0, 1.0)] * size,
        constraints=[constraint] if count else [],
        options={"maxiter": 200, "ftol": 1e-10},
    )
    return np.asarray(np.clip(found.x, 0.0, 1.0)) if np.isfinite(found.x).all() else start


def _least_violation(programme: Programme, start: np.ndarray) -> np.ndarray:
    """Point of the least violation: minimise a slack t with margins + t >= 0."""
    size = len(start)
    slack = float(max(-programme.margins(start[None]).min(), 0.0))

    def shortfall(z: np.ndarray) -> np.ndarray:
        return np.asarray(programme.margins(np.clip(z[:-1], 0.0, 1.0)[None])[0] + z[-1])

    def slopes(z: np.ndarray) -> np.ndarray:
        own = _slopes(programme.margins, z[:-1])[1]
        return np.column_stack([own, np.ones(len(own))])

    way = np.append(np.zeros(size), 1.0)
    found = minimize(  # type: ignore[call-overload]  # scipy-stubs: no dicts of callables
        lambda z: (float(z[-1]), way),
        np.append(start, slack),
        jac=True,
        method="SLSQP",
        bounds=[(0.0, 1.0)] * size + [(0.0, None)],
        constraints=[{"type": "ineq", "fun": shortfall, "jac": slopes}],
        options={"maxiter": 200, "ftol": 1e-10},
    )
    return np.asarray(np.clip(found.x[:-1], 0.0, 1.0)) if np.isfinite(found.x).all() else start


def _slopes(work: Batch, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values [value] and their derivatives [value variable], one-sided at the bounds."""
    s = np.clip(s, 0.0, 1.0)
    up = np.minimum(s + DIFFERENCE, 1.0)
    down = np.maximum(s - DIFFERENCE, 0.0)
    eye = np.eye(len(s), dtype=bool)
    at = np.concatenate([s[None], np.where(eye, up, s), np.where(eye, down, s)])
    values = work(at)
    above, below = values[1 : 1 + len(s)], values[1 + len(s) :]
    return values[0], np.asarray(((above - below) / (up - down)[:, None]).T)

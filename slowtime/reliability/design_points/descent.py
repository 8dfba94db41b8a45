r"""Search of the point of a limit state nearest to the origin, from one start.

Minimises :math:`\|u\|` under :math:`g(u) = 0` by the improved HL-RF iteration of Zhang and Der
Kiureghian (1995); where that does not converge, as at a corner between two limit states, by
sequential quadratic programming (`scipy.optimize`, SLSQP).
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

G = Callable[[np.ndarray], np.ndarray]
STEP = 1e-5
"""Forward difference in standard normal space: half the digits of g."""

TOLERANCE = 1e-4
"""Of the point, over 1 + its distance, and of g, over its scale."""

GAIN = 1e-6
"""Of the distance, over 1 + itself: it grows with the square of the error of the point."""

LOOSE = 0.1
STILL = 3
"""Iterations without gain in distance after which a point is taken, as converged where the
next step would be shorter than `LOOSE`: near a flat minimum, steps do not vanish."""

ITERATIONS = 30
HALVINGS = 8
SECOND_TRY = 40
"""Iterations of SLSQP."""

FAR = 1e6
"""Largest size of g, over its scale, that SLSQP is told."""


@dataclasses.dataclass(frozen=True, slots=True)
class Descent:
    """Where a search ended."""

    u: Float[np.ndarray, " input"]
    slope: Float[np.ndarray, " input"]
    """Gradient of g there."""

    converged: bool


def gradient(g: G, u: np.ndarray, step: float = STEP) -> tuple[float, np.ndarray]:
    """Compute value and gradient by forward differences, in n + 1 calls [input].

    The limit state takes points [sample input]; `step` is in standard deviations.
    """
    values = g(np.concatenate([u[None], u + step * np.eye(len(u))]))
    # Where points count as failed without a value, the slope is no number.
    with np.errstate(invalid="ignore"):
        return float(values[0]), (values[1:] - values[0]) / step


def descend(g: G, start: np.ndarray, scale: float, *, again: bool = False) -> Descent | None:
    """Find the nearest point of the limit state from a start; None where the search fails.

    `scale` is the size of g far from failure, which its tolerance is a share of. With `again`,
    sequential quadratic programming is tried where the iteration does not converge. Gives the
    point, the gradient there, and whether the search converged.
    """
    u = start
    best: Descent | None = None
    still = 0
    value, slope = gradient(g, u)
    for _ in range(ITERATIONS):
        square = float(slope @ slope)
        if not np.isfinite(square) or square == 0.0 or not np.isfinite(value):
            break
        target = (slope @ u - value) / square * slope
        # The step is at most as long as the distance that still holds any probability.
        step = target - u
        length = float(np.linalg.norm(step))
        if length > 8.0:
            step *= 8.0 / length
        if abs(value) < TOLERANCE * scale:
            if length < TOLERANCE * (1.0 + np.linalg.norm(u)):
                return Descent(target, slope, True)
            gained = np.inf if best is None else np.linalg.norm(best.u) - np.linalg.norm(u)
            still = 0 if gained > GAIN * (1.0 + np.linalg.norm(u)) else still + 1
            if best is None or gained > 0.0:
                best = Descent(u, slope, False)
            if still >= STILL:
                return Descent(u, slope, True) if length < LOOSE else best
        weight = 2.0 * (np.linalg.norm(u) + 1.0) / np.sqrt(square)
        before = 0.5 * u @ u + weight * abs(value)
        u = _shortened(g, u, step, weight, before)
        value, slope = gradient(g, u)
    tried = _second_try(g, u if best is None else best.u, scale) if again else None
    return tried or best


def _shortened(
    g: G, u: np.ndarray, step: np.ndarray, weight: float, before: float
) -> np.ndarray:
    """Halve the step until distance and |g| together are less."""
    tried = u + step
    for _ in range(HALVINGS):
        merit = 0.5 * tried @ tried + weight * abs(float(g(tried[None])[0]))
        if merit < before:
            break
        step = 0.5 * step
        tried = u + step
    return np.asarray(tried)


def _second_try(g: G, start: np.ndarray, scale: float) -> Descent | None:
    # SLSQP steps to NaN where it finds no slope: the limit state is not to be asked there.
    def of(u: np.ndarray) -> float:
        if not np.isfinite(u).all():
            return FAR
        return float(np.clip(g(u[None])[0] / scale, -FAR, FAR))

    def slope_of(u: np.ndarray) -> np.ndarray:
        return gradient(g, u)[1] / scale if np.isfinite(u).all() else np.zeros(len(u))

    found: Any = minimize(  # type: ignore[call-overload]  # stubs want exact array ranks
        lambda u: 0.5 * float(u @ u),
        start,
        jac=lambda u: u,
        constraints=[
            {"type": "eq", "fun": of, "jac": slope_of},
        ],
        method="SLSQP",
        options={"maxiter": SECOND_TRY, "ftol": 1e-8},
    )
    if not np.all(np.isfinite(found.x)):
        return None
    value, slope = gradient(g, found.x)
    if not abs(value) < 1e-2 * scale or not np.any(slope) or not np.isfinite(slope).all():
        return None
    return Descent(np.asarray(found.x), slope, bool(found.success))

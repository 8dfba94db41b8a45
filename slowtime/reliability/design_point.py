r"""The likeliest failures: points of the limit state nearest to the origin.

Improved HL-RF of Zhang and Der Kiureghian (1995), from several starts, since a limit state may
have several nearest points and the iteration finds the one that it starts near.
"""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from .probability import LimitState

STEP = 1e-4
TOLERANCE = 1e-5
HALVINGS = 12
ITERATIONS = 60
APART = 0.3
"""Distance over the nearest point's own within which two points are one."""


@dataclasses.dataclass(frozen=True, slots=True)
class DesignPoint:
    """A point of the limit state that none about it is nearer than."""

    point: Float[np.ndarray, " input"]
    beta: float
    """Signed distance from the origin: negative where the origin itself fails."""

    calls: int

    @property
    def first_order(self) -> float:
        r"""Probability of failure if the limit state were a plane, :math:`\Phi(-\beta)`."""
        return float(ndtr(-self.beta))


def design_points(
    limit_state: LimitState,
    inputs: int,
    rng: np.random.Generator,
    *,
    starts: int = 8,
    within: float = 1.5,
) -> list[DesignPoint]:
    """Find distinct design points, the nearest first; those farther by `within` are left out.

    Raises
    ------
    ValueError
        If no start leads to the limit state.

    Examples
    --------
    >>> found = design_points(lambda u: 3.0 - u[:, 0], 2, np.random.default_rng(0))
    >>> round(found[0].beta, 6)
    3.0
    """
    origin = float(limit_state(np.zeros((1, inputs)))[0])
    begin = np.concatenate(
        [np.zeros((1, inputs)), 2.0 * rng.standard_normal((starts - 1, inputs))]
    )
    found: list[DesignPoint] = []
    calls = 1
    for start in begin:
        point, spent = _descend(limit_state, start, abs(origin))
        calls += spent
        if point is None:
            continue
        beta = float(np.linalg.norm(point)) * (1.0 if origin > 0.0 else -1.0)
        if all(np.linalg.norm(point - one.point) > APART * abs(beta) for one in found):
            found.append(DesignPoint(point, beta, 0))
    if not found:
        raise ValueError(
            f"No design point was found from {starts} starts. Check that the limit state "
            "changes sign and is smooth, give more starts, or use subset simulation."
        )
    found.sort(key=lambda one: abs(one.beta))
    near = [one for one in found if abs(one.beta) <= abs(found[0].beta) + within]
    return [dataclasses.replace(one, calls=calls) for one in near]


def _descend(
    limit_state: LimitState, start: np.ndarray, scale: float
) -> tuple[np.ndarray | None, int]:
    point, calls = start, 0
    scale = scale or 1.0
    for _ in range(ITERATIONS):
        value, slope = _slope(limit_state, point)
        calls += 2 * len(point) + 1
        size = float(slope @ slope)
        if not np.isfinite(size) or size == 0.0:
            return None, calls
        towards = (slope @ point - value) / size * slope
        step = towards - point
        if np.linalg.norm(step) < TOLERANCE * (1.0 + np.linalg.norm(point)) and abs(value) < (
            TOLERANCE * scale + 1e-9
        ):
            return towards, calls
        # The merit counts distance and value; a step that does not lessen it is halved.
        weight = 2.0 * np.linalg.norm(point) / np.sqrt(size) + 10.0 / np.sqrt(size)
        tried = point + step * 0.5 ** np.arange(HALVINGS)[:, None]
        merit = 0.5 * np.sum(tried**2, axis=1) + weight * np.abs(limit_state(tried))
        calls += HALVINGS
        before = 0.5 * point @ point + weight * abs(value)
        better = np.flatnonzero(merit < before)
        point = tried[better[0]] if len(better) else tried[int(np.argmin(merit))]
    return None, calls


def _slope(limit_state: LimitState, point: np.ndarray) -> tuple[float, np.ndarray]:
    steps = STEP * np.eye(len(point))
    values = limit_state(np.concatenate([point[None], point + steps, point - steps]))
    ahead, behind = values[1 : len(point) + 1], values[len(point) + 1 :]
    return float(values[0]), (ahead - behind) / (2.0 * STEP)

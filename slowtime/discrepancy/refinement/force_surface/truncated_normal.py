r"""Samples of a normal distribution within bounds, by exact Hamiltonian Monte Carlo.

Whitened, the variable moves as :math:`x(t) = s \sin t + x_0 \cos t` from a random velocity
:math:`s`, is reflected where it meets a bound, and is taken at :math:`t = \pi/2`.
"""

import numpy as np
from jaxtyping import Float

SEED = 20
"""[1] Of the random velocities, so that the same fit has the same band. Source: arbitrary."""
WARM_UP = 50
"""[samples] Dropped at the beginning, which is on a bound. Source: successive samples of this
method hardly depend on each other."""
MAX_BOUNCES = 2000
"""[reflections] Of one trajectory, after which it is taken where it is. Source: of 25 bounds
about as many are met."""
INSIDE = 1e-3
"""[standard deviations] From the nearest bound at which the first trajectory starts at least.
Source: far below what a band shows."""


def truncated_normal(
    covariance: Float[np.ndarray, "unknown unknown"],
    low: Float[np.ndarray, " unknown"],
    high: Float[np.ndarray, " unknown"],
    count: int,
) -> Float[np.ndarray, "sample unknown"]:
    r"""Sample a normal distribution of mean zero within bounds.

    References
    ----------
    .. [1] A. Pakman and L. Paninski, "Exact Hamiltonian Monte Carlo for truncated multivariate
       Gaussians", J. Comput. Graph. Stat. 23 (2014).
    """
    sd = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(sd, sd))
    root = vectors * np.sqrt(np.maximum(values, 1e-12))
    least, most = low / sd, high / sd
    normals = np.concatenate([root[np.isfinite(least)], -root[np.isfinite(most)]])
    offsets = np.concatenate([-least[np.isfinite(least)], most[np.isfinite(most)]])
    begun = np.clip(np.zeros(len(sd)), least + INSIDE, np.maximum(most - INSIDE, least))
    x = np.linalg.solve(root, begun)
    rng = np.random.default_rng(SEED)
    samples = np.empty((count, len(sd)))
    for number in range(-WARM_UP, count):
        x = _trajectory(x, rng.standard_normal(len(sd)), normals, offsets)
        if number >= 0:
            samples[number] = root @ x
    return np.clip(samples, least, most) * sd


def _trajectory(
    x: Float[np.ndarray, " unknown"],
    velocity: Float[np.ndarray, " unknown"],
    normals: Float[np.ndarray, "bound unknown"],
    offsets: Float[np.ndarray, " bound"],
) -> Float[np.ndarray, " unknown"]:
    """Follow one trajectory over a quarter of a turn, reflected where n x + offset is zero."""
    left, last = np.pi / 2, -1
    for _ in range(MAX_BOUNCES):
        along, speed = normals @ x, normals @ velocity
        size = np.hypot(along, speed)
        phase = np.arctan2(-speed, along)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = -offsets / size
            turn = np.arccos(np.clip(ratio, -1, 1))
        # n x falls through -offset where the phase is `turn`, within the coming full turn.
        meets = np.mod(turn - phase, 2 * np.pi)
        meets = np.where(np.abs(ratio) < 1, meets, np.inf)
        if last >= 0 and min(meets[last], 2 * np.pi - meets[last]) < 1e-9:
            meets[last] = np.inf
        first = int(np.argmin(meets)) if len(meets) else -1
        step = left if first < 0 else min(left, float(meets[first]))
        x, velocity = (
            velocity * np.sin(step) + x * np.cos(step),
            velocity * np.cos(step) - x * np.sin(step),
        )
        left -= step
        if left <= 0:
            return x
        normal = normals[first]
        velocity = velocity - 2 * (normal @ velocity) / (normal @ normal) * normal
        last = first
    return x

r"""Directional simulation: exact integration of the radius along random directions.

.. math:: P = E_a \Big[ \sum_{\text{failed } (r_1, r_2)} Q_n(r_1) - Q_n(r_2) \Big], \quad
          Q_n(r) = P(\chi_n^2 > r^2)
"""

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc, chdtri

from slowtime.reliability.problem import Evaluator, Problem
from slowtime.reliability.result import Result, Stopping, sampled

FIRST = 100
LEAST_HITS = 60
"""Directions that meet failure before the spread between directions is believed."""

REMOTEST = 1e-12
"""Probability beyond the reach: what fails only farther out is not seen."""

RINGS = 9
"""Radii at which each direction is evaluated; crossings in pairs between two are missed."""

REFINEMENTS = 12
ROUND = 5000
MOST_INPUTS = 20


def directional(problem: Problem, rng: np.random.Generator, stopping: Stopping) -> Result:
    """Directional simulation; exact for a sphere, slow for a plane in many inputs.

    Examples
    --------
    >>> from slowtime.reliability.problem import unknowns
    >>> sphere = Problem(unknowns(5), lambda u: 30.0 - np.sum(u**2, axis=1))
    >>> found = directional(sphere, np.random.default_rng(0), Stopping())
    >>> bool(abs(found.probability / chdtrc(5, 30.0) - 1.0) < 1e-3)
    True
    """
    g = Evaluator(problem)
    reach = float(np.sqrt(chdtri(problem.size, REMOTEST)))
    start = float(np.sqrt(chdtri(problem.size, 0.9)))
    radii = np.concatenate([[0.0], np.linspace(start, reach, RINGS)])
    each = np.empty(0)
    count = FIRST
    while True:
        each = np.concatenate([each, _directions(g, radii, count, rng)])
        value = float(each.mean())
        variation = _variation(each, value)
        hits = int(np.count_nonzero(each))
        if g.calls >= stopping.calls:
            break
        if variation <= stopping.variation and hits >= LEAST_HITS:
            break
        left = max((stopping.calls - g.calls) // (RINGS + 1), 1)
        count = min(_more(variation, len(each), stopping), left)
    warnings: tuple[str, ...] = ()
    if problem.size > MOST_INPUTS and value > 0.0 and variation > 2.0 * CLOSE:
        warnings = (
            f"In {problem.size} inputs few directions carry most of the probability. Use "
            "importance sampling or subset simulation.",
        )
    return sampled("directional", value, variation, g.calls, stopping, warnings=warnings)


def _variation(each: np.ndarray, value: float) -> float:
    if value <= 0.0:
        return np.inf
    sampling = float(each.std(ddof=1) / np.sqrt(len(each)) / value)
    # Crossings are found to a tolerance, which all directions of a sphere share.
    return float(np.hypot(sampling, CLOSE))


def _more(variation: float, drawn: int, stopping: Stopping) -> int:
    if not np.isfinite(variation):
        return min(drawn, ROUND)
    needed = drawn * ((variation / stopping.variation) ** 2 - 1.0)
    return int(np.clip(1.02 * needed, 20, min(drawn, ROUND)))


def _directions(
    g: Evaluator, radii: Float[np.ndarray, " ring"], count: int, rng: np.random.Generator
) -> Float[np.ndarray, " direction"]:
    """Conditional probability of failure along random directions."""
    size = g.problem.size
    normal = rng.standard_normal((count, size))
    ways = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    # The origin is common to all directions: one call of it does.
    centre = float(g(np.zeros((1, size)))[0])
    values = np.full((count, len(radii)), centre)
    u = ways[:, None, :] * radii[1:, None]
    values[:, 1:] = g(u.reshape(-1, size)).reshape(count, -1)
    fails = values <= 0.0
    which, ring = np.nonzero(fails[:, 1:] != fails[:, :-1])
    root = _crossings(
        g,
        ways[which],
        radii[ring],
        radii[ring + 1],
        values[which, ring],
        values[which, ring + 1],
    )
    beyond = chdtrc(size, root**2)
    # Passing into failure adds what lies beyond, passing out of it takes that away again.
    each = np.where(fails[:, 0], 1.0, 0.0)
    np.add.at(each, which, np.where(fails[which, ring], -beyond, beyond))
    # What lies beyond the reach is counted as the last ring found it.
    return np.asarray(np.maximum(each, 0.0))


def _crossings(
    g: Evaluator,
    ways: np.ndarray,
    lo: np.ndarray,
    hi: np.ndarray,
    at_lo: np.ndarray,
    at_hi: np.ndarray,
) -> Float[np.ndarray, " crossing"]:
    """Radii of crossings by regula falsi with halved ends (Illinois), all at once."""
    if not len(lo):
        return np.empty(0)
    lo, hi, a, b = lo.copy(), hi.copy(), at_lo.copy(), at_hi.copy()
    inside = at_lo <= 0.0
    moved = np.zeros(len(lo))
    root = lo
    going = np.ones(len(lo), dtype=bool)
    for _ in range(REFINEMENTS):
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            share = a / (a - b)
        # What counts as failed may be minus infinity, which tells the side and no distance.
        told = np.isfinite(share) & np.isfinite(a) & np.isfinite(b)
        share = np.where(told, np.clip(share, 0.05, 0.95), 0.5)
        before = root
        root = np.where(going, lo + share * (hi - lo), root)
        value = np.zeros(len(lo))
        value[going] = g(ways[going] * root[going, None])
        same = (value <= 0.0) == inside
        lower, upper = going & same, going & ~same
        # The end that stays twice has its value halved, so that it moves as well.
        b = np.where(lower & (moved > 0), 0.5 * b, b)
        a = np.where(upper & (moved < 0), 0.5 * a, a)
        lo, a = np.where(lower, root, lo), np.where(lower, value, a)
        hi, b = np.where(upper, root, hi), np.where(upper, value, b)
        moved = np.where(same, 1.0, -1.0)
        going &= (np.abs(root - before) * np.maximum(root, 1.0) > CLOSE) & (hi - lo > 1e-9)
        if not going.any():
            break
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        share = a / (a - b)
    told = np.isfinite(share) & np.isfinite(a) & np.isfinite(b)
    share = np.where(told, np.clip(share, 0.0, 1.0), 0.5)
    last = lo + share * (hi - lo)
    return np.asarray(np.where(going, last, root))


CLOSE = 3e-3
"""Step of a crossing, times its radius, that changes the probability beyond by 0.3 %."""

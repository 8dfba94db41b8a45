r"""Stratified sampling in rings of standard normal space.

.. math:: P = \sum_k p_k \bar I_k, \quad \mathrm{var} = \sum_k p_k^2 v_k / n_k

Points go where they lessen the variance most, :math:`n_k \propto p_k \sqrt{v_k}` (Neyman).
"""

import numpy as np
from jaxtyping import Float
from scipy.special import chdtri

from slowtime.reliability.problem import Evaluator, Problem
from slowtime.reliability.result import Result, Stopping, sampled

RINGS = 24
"""Strata; each holds the fourth root of a tenth of the probability beyond the one before."""

RATIO = 10.0**-0.25
FIRST = 50
"""Points of each stratum in the first round."""

MOST_INPUTS = 10
SAFE = 2
"""Rings within the innermost failure that are still doubted."""

ROUND = 20_000
PRIOR = 0.5
"""Failures and survivals added where the spread of a stratum is estimated (Jeffreys)."""


def stratified(problem: Problem, rng: np.random.Generator, stopping: Stopping) -> Result:
    """Radial strata with optimal allocation; for up to about ten inputs.

    Examples
    --------
    >>> from scipy.special import chdtrc
    >>> from slowtime.reliability.problem import unknowns
    >>> sphere = Problem(unknowns(3), lambda u: 25.0 - np.sum(u**2, axis=1))
    >>> found = stratified(sphere, np.random.default_rng(0), Stopping())
    >>> bool(abs(found.probability / chdtrc(3, 25.0) - 1.0) < 0.2)
    True
    """
    g = Evaluator(problem)
    beyond = np.append(RATIO ** np.arange(RINGS), 0.0)
    held = beyond[:-1] - beyond[1:]
    drawn, failed = np.zeros(RINGS), np.zeros(RINGS)
    counts = np.full(RINGS, FIRST)
    while True:
        ring = np.repeat(np.arange(RINGS), counts)
        u = _points(rng, ring, beyond, problem.size)
        failed += np.bincount(ring[g(u) <= 0.0], minlength=RINGS)
        drawn += counts
        value = float(held @ (failed / drawn))
        spread = _variance_within(failed, drawn)
        error = float(np.sqrt(np.sum(held**2 * spread / drawn)))
        variation = error / value if value > 0.0 else np.inf
        if variation <= stopping.variation or g.calls >= stopping.calls:
            break
        counts = _allocated(held * np.sqrt(spread), drawn, error, value, g.calls, stopping)
    warnings: tuple[str, ...] = ()
    if problem.size > MOST_INPUTS:
        warnings = (
            f"Radial strata help little in {problem.size} inputs (up to {MOST_INPUTS}). Use "
            "subset simulation or importance sampling.",
        )
    return sampled("stratified", value, variation, g.calls, stopping, warnings=warnings)


def _variance_within(failed: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    """Variance within each stratum: of rings in which none failed, not quite 0."""
    # Rings further in than `SAFE` below the innermost failure count as safe: a safe set that is
    # star-shaped about the origin has none there.
    share = (failed + PRIOR) / (drawn + 2.0 * PRIOR)
    if failed.any():
        innermost = int(np.flatnonzero(failed)[0])
        share[: max(innermost - SAFE, 0)] = 0.0
    return np.asarray(share * (1.0 - share))


def _allocated(
    need: np.ndarray,
    drawn: np.ndarray,
    error: float,
    value: float,
    calls: int,
    stopping: Stopping,
) -> np.ndarray:
    total = float(drawn.sum())
    factor = (error / (stopping.variation * value)) ** 2 if value > 0.0 else 4.0
    number = min(max(total * min(factor, 3.0) - total, 200.0), ROUND, stopping.calls - calls)
    goal = (total + number) * need / need.sum()
    lacking = np.maximum(goal - drawn, 0.0)
    return np.asarray(np.ceil(number * lacking / lacking.sum()).astype(int))


def _points(
    rng: np.random.Generator,
    ring: np.ndarray,
    beyond: Float[np.ndarray, " edge"],
    inputs: int,
) -> np.ndarray:
    tail = beyond[ring + 1] + rng.uniform(size=len(ring)) * (beyond[ring] - beyond[ring + 1])
    radius = np.sqrt(chdtri(inputs, tail))
    ways = rng.standard_normal((len(ring), inputs))
    return np.asarray(ways * (radius / np.linalg.norm(ways, axis=1))[:, None])

"""Crude Monte Carlo simulation (eq. 4.10)."""

import numpy as np
from scipy.special import betainccinv, betaincinv

from slowtime.reliability.problem import Evaluator, Problem
from slowtime.reliability.result import LEVEL, Result, Stopping

RAREST = 1e-4
"""Probability below which crude sampling is refused: at 5 % it takes four million points."""

BATCH = 20_000
SURE = 0.001
"""Chance of giving a problem up although its probability is above `RAREST`."""


def monte_carlo(problem: Problem, rng: np.random.Generator, stopping: Stopping) -> Result:
    r"""Share of failures among random points, with its exact interval (Clopper–Pearson).

    A coefficient of variation :math:`\delta` takes :math:`(1 - P) / (P \delta^2)` points. As
    soon as the probability is seen to lie below 1e-4, sampling ends and the result says so.

    Examples
    --------
    >>> from slowtime.reliability.problem import unknowns
    >>> found = monte_carlo(
    ...     Problem(unknowns(1), lambda u: 2.0 - u[:, 0]), np.random.default_rng(0), Stopping())
    >>> found.interval[0] < 0.02275 < found.interval[1]
    True
    """
    g = Evaluator(problem)
    failed = count = 0
    rare = False
    while True:
        left = stopping.calls - count
        wanted = _further_points(failed, count, stopping)
        number = int(min(max(wanted, 100), BATCH, left))
        failed += int(np.sum(g(rng.standard_normal((number, problem.size))) <= 0.0))
        count += number
        value = failed / count
        variation = float(np.sqrt((1.0 - value) / failed)) if failed else np.inf
        enough = failed and variation <= stopping.variation
        rare = count >= BATCH and _upper(failed, count, SURE) < RAREST
        if enough or rare or count >= stopping.calls:
            break
    tail = 0.5 * (1.0 - LEVEL)
    lo = float(betaincinv(failed, count - failed + 1, tail)) if failed else 0.0
    # With no failure only the upper end is unknown, and it takes the whole of the doubt.
    hi = _upper(failed, count, tail if failed else 2.0 * tail)
    warnings: tuple[str, ...] = ()
    if rare:
        warnings = (
            f"The probability is below {RAREST:g} ({failed} of {count} points failed): crude "
            "Monte Carlo is not for such. Use importance sampling or subset simulation.",
        )
    elif not enough:
        warnings = (
            f"{failed} of {count} points failed: the coefficient of variation is "
            f"{variation:.2g}, not {stopping.variation:g}. Allow more calls.",
        )
    return Result("monte-carlo", value, (lo, hi), "", variation, g.calls, warnings=warnings)


def _upper(failed: int, count: int, chance: float) -> float:
    return float(betainccinv(failed + 1, count - failed, chance)) if failed < count else 1.0


def _further_points(failed: int, count: int, stopping: Stopping) -> float:
    """Further points that the target needs as far as is known."""
    if not failed:
        return 1000.0 if not count else float(BATCH)
    value = failed / count
    return 1.02 * (1.0 - value) / value / stopping.variation**2 - count

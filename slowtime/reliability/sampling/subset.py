r"""Subset simulation: rare failures as a chain of likelier events.

.. math:: P = p_0^{m - 1} \, P(F \mid F_{m-1})

Each level is where a share :math:`p_0` of the last one's points do worst; from these, Markov
chains draw new points under the condition of staying there. Independent runs are averaged:
their spread tells the error without any assumption on the memory of the chains.
"""

import numpy as np
from jaxtyping import Float

from slowtime.reliability.problem import Evaluator, Problem
from slowtime.reliability.result import Result, Stopping, sampled

ACCEPTED = 0.44
"""Share of moves that makes chains forget fastest (Papaioannou et al. 2015)."""

SHARE = 0.1
LENGTH = 10
"""Steps of a chain, its seed included: the inverse of the share."""

LEVELS = 14
LEAST_RUNS = 10
"""Independent runs before their spread is believed."""


def subset_simulation(
    problem: Problem,
    rng: np.random.Generator,
    stopping: Stopping,
    *,
    samples: int = 1000,
) -> Result:
    r"""Subset simulation: a few thousand calls a run, in any number of inputs.

    Moves are :math:`u' = \rho u + \sqrt{1 - \rho^2} \, \xi`, which leave the normal
    distribution as it is; :math:`\rho` follows the share of moves accepted.

    Parameters
    ----------
    problem
        Inputs and limit state.
    rng
        Generator of the samples.
    stopping
        Targets of the sampling.
    samples
        Of each level and run, a multiple of 10.

    Returns
    -------
    Probability of failure, with its interval.

    References
    ----------
    .. [1] S.-K. Au and J. L. Beck, "Estimation of small failure probabilities in high
       dimensions by subset simulation", Probab. Eng. Mech. 16 (2001) 263-277.
    .. [2] I. Papaioannou et al., "MCMC algorithms for subset simulation", Probab. Eng. Mech.
       41 (2015) 89-103.
    """
    if samples % LENGTH or samples < 10 * LENGTH:
        raise ValueError(f"{samples=} is not a multiple of {LENGTH} from {10 * LENGTH} on.")
    g = Evaluator(problem)
    runs: list[float] = []
    while True:
        runs.append(_run(g, samples, rng))
        each = np.array(runs)
        value = float(each.mean())
        variation = np.inf
        if len(runs) > 1 and value > 0.0:
            variation = float(each.std(ddof=1) / np.sqrt(len(runs)) / value)
        if g.calls >= stopping.calls:
            break
        if len(runs) >= LEAST_RUNS and (variation <= stopping.variation or value == 0.0):
            break
    warnings: tuple[str, ...] = ()
    if value == 0.0:
        warnings = (f"Failure is rarer than {LEVELS} levels reach, {SHARE**LEVELS:.0e}.",)
    elif float(np.median(each)) < 0.3 * value:
        warnings = (
            f"Few of {len(runs)} runs make up the probability: most miss the failure mode that "
            "matters. Give more samples, or use importance sampling.",
        )
    return sampled(
        "subset",
        value,
        variation,
        g.calls,
        stopping,
        warnings=warnings,
        freedom=float(max(len(runs) - 1, 1)),
    )


def _run(g: Evaluator, samples: int, rng: np.random.Generator) -> float:
    seeds = samples // LENGTH
    points = rng.standard_normal((samples, g.problem.size))
    values = g(points)
    width = 0.6
    for level in range(LEVELS):
        order = np.argsort(values, kind="stable")
        threshold = 0.5 * float(values[order[seeds - 1]] + values[order[seeds]])
        if not threshold > 0.0 or level == LEVELS - 1:
            return float(SHARE**level * np.mean(values <= 0.0))
        chosen = order[:seeds]
        points, values, width = _chains(
            g, points[chosen], values[chosen], threshold, width, rng
        )
    raise AssertionError("the last level returns")


def _chains(
    g: Evaluator,
    points: Float[np.ndarray, "seed input"],
    values: Float[np.ndarray, " seed"],
    threshold: float,
    width: float,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Continue every seed to a chain; the width of moves is carried to the next level."""
    every, each = [points], [values]
    for step in range(1, LENGTH):
        moved = np.sqrt(1.0 - width**2) * points + width * rng.standard_normal(points.shape)
        tried = g(moved)
        accepted = tried <= threshold
        points = np.where(accepted[:, None], moved, points)
        values = np.where(accepted, tried, values)
        every.append(points)
        each.append(values)
        rate = float(accepted.mean()) - ACCEPTED
        width = float(np.clip(width * np.exp(rate / np.sqrt(step)), 0.05, 1.0))
    return np.concatenate(every), np.concatenate(each), width

r"""Subset simulation: a rare failure as a chain of likelier ones.

.. math:: P = p_0^{m - 1} \, P(F \mid F_{m-1})

Each level is where a share :math:`p_0` of the last one's points do worst; from these, chains
draw new points under the condition of staying there.
"""

import numpy as np
from jaxtyping import Float

from .probability import LimitState, Probability, lognormal

ACCEPTED = 0.44
"""Share of moves that makes chains forget fastest (Papaioannou et al. 2015)."""


def subset_simulation(
    limit_state: LimitState,
    inputs: int,
    rng: np.random.Generator,
    *,
    samples: int = 2000,
    share: float = 0.1,
    levels: int = 15,
) -> Probability:
    r"""Estimate a small probability with a few thousand calls, in any number of inputs.

    Moves are :math:`u' = \rho u + \sqrt{1 - \rho^2} \, \xi`, which leave the normal law as it
    is; :math:`\rho` follows the share of moves accepted. The coefficient of variation takes the
    memory of the chains into account, and stands midway between that of levels which err
    independently and of levels which err together, for chains pass their errors on.

    Parameters
    ----------
    samples
        Of each level, the seeds of its chains among them.
    share
        :math:`p_0`; its inverse, the length of chains, is a whole number, and so are the seeds.
    levels
        At most; a failure rarer than they reach is said to be that rare at most.

    References
    ----------
    .. [1] S.-K. Au and J. L. Beck, "Estimation of small failure probabilities in high
       dimensions by subset simulation", Probab. Eng. Mech. 16 (2001) 263-277.
    .. [2] I. Papaioannou et al., "MCMC algorithms for subset simulation", Probab. Eng. Mech.
       41 (2015) 89-103.

    Examples
    --------
    >>> found = subset_simulation(lambda u: 4.0 - u[:, 0], 2, np.random.default_rng(0))
    >>> 1.5e-5 < found.value < 6e-5
    True
    """
    length, seeds = round(1.0 / share), round(share * samples)
    if not np.isclose(length * share, 1.0) or seeds * length != samples or seeds < 2:
        raise ValueError(
            f"{samples=} and {share=} do not make chains of whole length. Give a share such as "
            "0.1 or 0.2, and samples that are a multiple of its inverse."
        )
    points = rng.standard_normal((samples, inputs))
    values = limit_state(points)
    calls, width = samples, 0.6
    each: list[float] = []
    for level in range(levels):
        ranked = np.sort(values)
        threshold = 0.5 * (ranked[seeds - 1] + ranked[seeds])
        last = threshold <= 0.0 or level == levels - 1
        passed = values < (0.0 if last else threshold)
        p = float(passed.mean())
        each.append(_variation(passed, p, length if level else 1))
        if last or p == 0.0:
            value = share**level * p
            if p == 0.0:
                said = (f"Failure is rarer than {levels} levels reach: {share**level:.0e}.",)
                return Probability(0.0, np.inf, 0.0, share**level, calls, said)
            together, apart = float(np.sum(each)), float(np.linalg.norm(each))
            return lognormal(value, 0.5 * (together + apart), calls)
        chosen = np.argsort(values)[:seeds]
        points, values, width = _chains(
            limit_state, points[chosen], values[chosen], threshold, length, width, rng
        )
        calls += samples - seeds
    raise AssertionError("the last level returns")


def _chains(
    limit_state: LimitState,
    points: Float[np.ndarray, "seed input"],
    values: Float[np.ndarray, " seed"],
    threshold: float,
    length: int,
    width: float,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Continue every seed to a chain; samples come chain by chain within each step."""
    every, each = [points], [values]
    for step in range(1, length):
        rho = np.sqrt(1.0 - width**2)
        moved = rho * points + width * rng.standard_normal(points.shape)
        tried = limit_state(moved)
        accepted = tried < threshold
        points = np.where(accepted[:, None], moved, points)
        values = np.where(accepted, tried, values)
        every.append(points)
        each.append(values)
        rate = float(accepted.mean()) - ACCEPTED
        width = float(np.clip(width * np.exp(rate / np.sqrt(step)), 0.05, 1.0))
    return np.concatenate(every), np.concatenate(each), width


def _variation(passed: np.ndarray, p: float, length: int) -> float:
    """Coefficient of variation of one level, the memory of its chains counted."""
    if p in (0.0, 1.0):
        return 0.0
    steps = passed.reshape(length, -1).astype(float)
    variance = p * (1.0 - p)
    memory = 0.0
    for lag in range(1, length):
        correlation = float(np.mean(steps[:-lag] * steps[lag:]) - p**2) / variance
        memory += 2.0 * (1.0 - lag / length) * correlation
    return float(np.sqrt((1.0 - p) / (p * len(passed)) * (1.0 + max(memory, 0.0))))

r"""Chains that walk from failing points to the distribution of failures.

Moves :math:`u' = \rho u + \sqrt{1 - \rho^2}\, \xi` leave the standard normal distribution as
it is, in any number of inputs; those that do not fail are refused. So each chain ends as if it
were drawn from the failures by their own probability, whatever density its start came from.
"""

import numpy as np
from jaxtyping import Float

from slowtime.reliability.problem import Evaluator

CHAINS = 60
"""[chains] A failing region that holds a tenth of the probability is met by six of them.
Source: the mean of the binomial distribution."""

STEPS = 5
"""[steps] Of each chain: with `RHO` they forget all but a tenth of their start. Source:
0.64^5 = 0.11, the correlation of a chain none of whose moves is refused."""

RHO = 0.64
"""[1] Correlation of a move with where it began. Source: about half of the moves are accepted
beyond a plane at distances of 2 to 4, which is where chains mix best (Papaioannou et al.,
Probab. Eng. Mech. 41, 2015)."""


def walk(
    g: Evaluator,
    u: Float[np.ndarray, "failure input"],
    weight: Float[np.ndarray, " failure"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "chain input"]:
    """Walk from failures, drawn by their weights, to the distribution of failures.

    The limit state is called `CHAINS` times `STEPS` times.
    """
    # Systematic resampling: each point starts as many chains as its weight says, to within one.
    places = (np.arange(CHAINS) + rng.uniform()) / CHAINS
    chosen = np.searchsorted(np.cumsum(weight) / weight.sum(), places)
    at = u[np.minimum(chosen, len(u) - 1)]
    for _ in range(STEPS):
        moved = RHO * at + np.sqrt(1.0 - RHO**2) * rng.standard_normal(at.shape)
        at = np.where((g(moved) <= 0.0)[:, None], moved, at)
    return np.asarray(at)

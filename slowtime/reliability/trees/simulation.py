"""Failure probability of a tree by Monte Carlo simulation of its members."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from .dependence import Group, grouped
from .structure import Node, fails, members

_AT_ONCE = 200_000


def simulate(
    tree: Node,
    marginals: Mapping[str, float],
    groups: Sequence[Group],
    rng: np.random.Generator,
    count: int,
) -> tuple[float, float]:
    """Simulate which members fail, and count the cases in which the tree fails.

    Parameters
    ----------
    tree
        Tree of members and gates.
    marginals
        Failure probability of each member [1].
    groups
        As for `analyse`.
    rng
        Generator of the draws.
    count
        Cases.

    Returns
    -------
    Estimate of the failure probability, and its standard deviation.
    """
    each = grouped(members(tree), tuple(groups))
    failures = 0
    for first in range(0, count, _AT_ONCE):
        cases = min(_AT_ONCE, count - first)
        failed = {
            name: drawn
            for group in each
            for name, drawn in group.draw(marginals, rng, cases).items()
        }
        failures += int(np.sum(fails(tree, failed)))
    p = failures / count
    return p, math.sqrt(p * (1.0 - p) / count)

"""Interval of a tree's failure probability from those of its members."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import scipy
from scipy.special import ndtri

from .dependence import Group
from .probability import probability
from .structure import Node, members

LEVEL = 0.95
"""Share that a band holds: from the 2.5 % to the 97.5 % quantile."""

DRAWS = 1000
"""Drawn by Latin hypercube: the ends of the band then vary by about 2 % of its width."""


class ProbabilityBounds(NamedTuple):
    """What is known of a failure probability.

    Parameters
    ----------
    value
        With each member at its own value; NaN where one of them is not known.
    lo, hi
        The band, the errors of the members' probabilities being independent.
    lowest, highest
        With all members at the lower ends, and all at the upper ends, of their bands: the
        errors all have one cause. Where a member is not known, the band is this one.
    """

    value: float
    lo: float
    hi: float
    lowest: float
    highest: float


def band(
    tree: Node,
    bands: Mapping[str, tuple[float, float, float]],
    rng: np.random.Generator,
    groups: Sequence[Group] = (),
    *,
    draws: int = DRAWS,
) -> ProbabilityBounds:
    """Propagate the uncertainty of the members' probabilities through a tree.

    The failure probability of a tree rises with that of each member, so that the ends of all
    bands together bound it.

    Parameters
    ----------
    tree
        Tree of members and gates.
    bands
        Of each member: value, and the ends of its 95 % band. A value of NaN stands for a
        probability that is not known; its band is then 0 to 1.
    rng
        Draws the members' probabilities, from normal halves on both sides of the value that
        have the ends of the band as their 2.5 % and 97.5 % quantiles.
    groups
        Members that do not fail independently; each member in one group at most.
    draws
        Number of draws.

    Returns
    -------
    Value and ends of the band of the tree's failure probability.
    """
    names = members(tree)
    for name in names:
        value, lo, hi = bands[name]
        if not (0.0 <= lo <= hi <= 1.0) or (value == value and not lo <= value <= hi):
            raise ValueError(
                f"The failure probability of {name!r:.80} was given as {value:g} with the band "
                f"{lo:g} to {hi:g}. Give 0 <= lo <= value <= hi <= 1."
            )
    table = np.array([bands[name] for name in names])
    known = not np.isnan(table[:, 0]).any()
    ends = {name: row[1:] for name, row in zip(names, table, strict=True)}
    lowest, highest = probability(tree, ends, groups).tolist()
    if not known:
        return ProbabilityBounds(float("nan"), lowest, highest, lowest, highest)
    exact = probability(tree, {n: r[:1] for n, r in zip(names, table, strict=True)}, groups)
    cube = scipy.stats.qmc.LatinHypercube(len(names), rng=rng).random(draws)
    scores = ndtri(cube).T / ndtri(0.5 + LEVEL / 2.0)
    value, lo, hi = (column[:, None] for column in table.T)
    drawn = value + np.where(scores > 0, (hi - value) * scores, (value - lo) * scores)
    cases = dict(zip(names, np.clip(drawn, 0.0, 1.0), strict=True))
    found = probability(tree, cases, groups)
    ends_of_band = np.quantile(found, [0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0]).tolist()
    middle = float(exact[0])
    return ProbabilityBounds(
        middle, min(ends_of_band[0], middle), max(ends_of_band[1], middle), lowest, highest
    )

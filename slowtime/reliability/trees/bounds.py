r"""Bounds of a tree's failure probability under any dependence of the members.

With :math:`p_{(1)} \le \dots \le p_{(n)}`, at least r of n events happen with a probability of
at most :math:`\min_{l<r} \, (p_{(1)} + \dots + p_{(n-l)}) / (r - l)`. Applied to what works,
the same bounds it from below. For one gate over members the bounds are attained.

References
----------
.. [1] B. Rüger, "Scharfe untere und obere Schranken für die Wahrscheinlichkeit der
   Realisation von k unter n Ereignissen", Metrika 25 (1978) 71-77.
"""

from collections.abc import Mapping, Sequence

from .structure import Node


def any_dependence(tree: Node, marginals: Mapping[str, float]) -> tuple[float, float]:
    """Bound the failure probability of a tree from below and from above.

    Parameters
    ----------
    tree
        Tree of members and gates.
    marginals
        Failure probability of each member [1].

    Returns
    -------
    Lower and upper bound, whatever the dependence of the members [1].

    Examples
    --------
    >>> from slowtime.reliability.trees import parallel, series
    >>> marginals = {"a": 0.1, "b": 0.2}
    >>> tuple(round(p, 3) for p in any_dependence(series("a", "b"), marginals))
    (0.2, 0.3)
    >>> any_dependence(parallel("a", "b"), marginals)
    (0.0, 0.1)
    """
    if isinstance(tree, str):
        return marginals[tree], marginals[tree]
    below = [any_dependence(one, marginals) for one in tree.inputs]
    count, needed = len(below), tree.failures
    working = [1.0 - lo for lo, _ in below]
    lo = 1.0 - _at_least(count - needed + 1, working)
    return max(lo, 0.0), _at_least(needed, [hi for _, hi in below])


def _at_least(count: int, probabilities: Sequence[float]) -> float:
    """Bound from above the probability that at least `count` of some events happen."""
    ascending = sorted(probabilities)
    n = len(ascending)
    return min(1.0, *(sum(ascending[: n - left]) / (count - left) for left in range(count)))

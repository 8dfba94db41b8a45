"""Failure probability of a tree, and the importance of each member.

Members of a group stand together in the order of the diagram's variables. From its end
towards its root, each group is then integrated over its common factor once, and what is below
it is a number by that time: all integrals are over one dimension, whatever the number of
groups.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from .bounds import any_dependence
from .dependence import ConditionalMembers, Group, Marginals, grouped
from .diagram import Diagram, TooLargeTreeError
from .structure import Node, members

MOST_VALUES = 4_000_000
"""Numbers held at once for the conditional probabilities: 32 MB."""


@dataclasses.dataclass(frozen=True, slots=True)
class Importance:
    r"""How much a member matters.

    Parameters
    ----------
    birnbaum
        Probability that the member is critical: that the others are in a state in which the
        system fails if it fails and works if it works. Of independent members it is
        :math:`\partial P_f / \partial p_i`.
    criticality
        Probability that the member is critical and has failed, given that the system has:
        the share of failures that would not be if this member could not fail.
    fussell_vesely
        Probability that all of some minimal cut set with the member has failed, given that the
        system has; NaN where the minimal cut sets are too many to be counted.

    References
    ----------
    .. [1] M. Rausand and A. Høyland, "System Reliability Theory", 2nd ed., Wiley (2004),
       chapter 5.
    """

    birnbaum: float
    criticality: float
    fussell_vesely: float


@dataclasses.dataclass(frozen=True, slots=True)
class TreeResult:
    """What is known of a tree.

    Parameters
    ----------
    probability
        That it fails, exact under the stated dependence.
    bounds
        Between which it is, whatever the dependence of the members.
    importance
        Of each member.
    """

    probability: float
    bounds: tuple[float, float]
    importance: Mapping[str, Importance]


def probability(
    tree: Node, marginals: Marginals, groups: Sequence[Group] = ()
) -> Float[np.ndarray, " case"]:
    """Failure probability of a tree in each of some cases.

    Parameters
    ----------
    tree
        Tree of members and gates.
    marginals
        Of each member, its failure probability in each case, all of one shape.
    groups
        Members that do not fail independently; each member in one group at most.

    Returns
    -------
    Probability in each case [1].

    Examples
    --------
    >>> from slowtime.reliability.trees import parallel, series
    >>> tree = parallel(series("a", "b"), series("a", "c"))  # a is in both branches
    >>> one = np.array([0.1])
    >>> [round(float(p), 6) for p in probability(tree, {"a": one, "b": one, "c": one})]
    [0.109]
    """
    plan = _Plan(tree, groups)
    _check(plan.names, marginals)
    return np.asarray(plan.evaluate([plan.root], marginals)[0])


def analyse(
    tree: Node, marginals: Mapping[str, float], groups: Sequence[Group] = ()
) -> TreeResult:
    """Failure probability of a tree, its bounds, and the importance of each member.

    Parameters
    ----------
    tree
        Tree of members and gates.
    marginals
        Failure probability of each member [1].
    groups
        Members that do not fail independently; each member in one group at most.

    Returns
    -------
    Probability, bounds and importances [1].

    Raises
    ------
    ValueError
        Where a probability is missing or outside [0, 1], or a member is in two groups.
    TooLargeTreeError
        Where the tree's diagram does not fit.
    """
    plan = _Plan(tree, groups)
    _check(plan.names, marginals)
    one = {name: np.array([marginals[name]], dtype=np.float64) for name in plan.names}
    whole, *of_cuts = plan.evaluate([plan.root, *plan.cut_events()], one)[:, 0].tolist()
    of_cuts = of_cuts or [math.nan] * len(plan.names)
    critical, at_fault = plan.criticality(one)
    importance = {
        name: Importance(
            birnbaum=critical[name],
            criticality=_share(at_fault[name], whole),
            fussell_vesely=_share(of_cut, whole),
        )
        for name, of_cut in zip(plan.names, of_cuts, strict=True)
    }
    return TreeResult(whole, any_dependence(tree, marginals), importance)


class _Plan:
    """A tree as a diagram whose variables stand in the order of the groups."""

    def __init__(self, tree: Node, groups: Sequence[Group]) -> None:
        self.names = members(tree)
        self._groups = grouped(self.names, tuple(groups))
        order = [name for group in self._groups for name in _as_placed(group, self.names)]
        self._variables = {name: number for number, name in enumerate(order)}
        self._order = order
        self._group_of = [
            number for number, group in enumerate(self._groups) for _ in group.members
        ]
        self._diagram = Diagram()
        self.root = self._diagram.build(tree, self._variables)

    def cut_events(self) -> list[int]:
        """Make of each member "all of some minimal cut set with it has failed".

        Empty where the cut sets are too many.
        """
        diagram = self._diagram
        try:
            cuts = diagram.minimal(self.root)
            numbers = [self._variables[name] for name in self.names]
            return [diagram.closure(diagram.containing(cuts, one)) for one in numbers]
        except TooLargeTreeError:
            return []

    def evaluate(
        self, roots: Sequence[int], marginals: Marginals
    ) -> Float[np.ndarray, "root case"]:
        """Probability of each of some functions, in each case."""
        blocks = self._blocks(roots)
        cases = len(marginals[self.names[0]])
        first = self._conditionals({name: marginals[name][:1] for name in self.names})
        most = max(
            len(one.weights) * (len(one.failing) + len(blocks.get(number, ())))
            for number, one in enumerate(first)
        )
        step = max(1, MOST_VALUES // most)
        parts = []
        for start in range(0, cases, step):
            part = {name: marginals[name][start : start + step] for name in self.names}
            mean = self._sweep(blocks, self._conditionals(part), min(step, cases - start))
            parts.append(np.stack([mean[root] for root in roots]))
        # Weights sum to one but for rounding.
        return np.asarray(np.clip(np.concatenate(parts, axis=1), 0.0, 1.0))

    def criticality(self, marginals: Marginals) -> tuple[dict[str, float], dict[str, float]]:
        """Probability that each member is critical, and that it is so and has failed."""
        # A path from the root decides the system at a node of the member with the probability
        # that it gets there, times the difference of what is below: so all members cost one
        # more pass, from the root down.
        blocks, given = self._blocks([self.root]), self._conditionals(marginals)
        within: dict[int, Float[np.ndarray, "value 1"]] = {}
        mean = self._sweep(blocks, given, 1, within)
        critical, at_fault = dict.fromkeys(self.names, 0.0), dict.fromkeys(self.names, 0.0)
        entered: dict[int, float] = {self.root: 1.0}
        for number in sorted(blocks):
            weights, failing = given[number]
            inside = set(blocks[number])
            reach: dict[int, Any] = {node: entered.get(node, 0.0) for node in inside}
            for node in reversed(blocks[number]):
                name = self._order[self._diagram.variable[node]]
                p, path = failing[name], weights * reach[node]
                ends = self._diagram.low[node], self._diagram.high[node]
                below = [within[end] if end in inside else mean[end] for end in ends]
                decided = path * (below[1] - below[0])
                critical[name] += float(np.sum(decided))
                at_fault[name] += float(np.sum(p * decided))
                for end, chance in zip(ends, (1.0 - p, p), strict=True):
                    if end in inside:
                        reach[end] = reach[end] + reach[node] * chance
                    else:
                        entered[end] = entered.get(end, 0.0) + float(np.sum(path * chance))
        return critical, at_fault

    def _conditionals(self, marginals: Marginals) -> list[ConditionalMembers]:
        return [group.given(marginals) for group in self._groups]

    def _blocks(self, roots: Sequence[int]) -> dict[int, list[int]]:
        """Nodes of each group, children before parents."""
        found: dict[int, list[int]] = {}
        for node in self._diagram.reachable(roots):
            found.setdefault(self._group_of[self._diagram.variable[node]], []).append(node)
        return found

    def _sweep(
        self,
        blocks: Mapping[int, Sequence[int]],
        given: Sequence[ConditionalMembers],
        cases: int,
        within: dict[int, Float[np.ndarray, "value case"]] | None = None,
    ) -> dict[int, Float[np.ndarray, " case"]]:
        """Go through the diagram once: probability of each node; `within`, given a factor."""
        diagram = self._diagram
        mean = {0: np.zeros(cases), 1: np.ones(cases)}
        for number in sorted(blocks, reverse=True):
            weights, failing = given[number]
            at: dict[int, Float[np.ndarray, "value case"]] = {}
            for node in blocks[number]:
                low, high = diagram.low[node], diagram.high[node]
                p = failing[self._order[diagram.variable[node]]]
                up = at[high] if high in at else mean[high]
                down = at[low] if low in at else mean[low]
                at[node] = p * up + (1.0 - p) * down
            mean |= {node: np.sum(weights * value, axis=0) for node, value in at.items()}
            if within is not None:
                within |= at
        return mean


def _as_placed(group: Group, names: Sequence[str]) -> list[str]:
    """Sort the members of a group as the tree names them, which keeps a diagram small."""
    place = {name: number for number, name in enumerate(names)}
    return sorted(group.members, key=place.__getitem__)


def _share(part: float, whole: float) -> float:
    share = part / whole if whole > 0.0 else 0.0
    return share if math.isnan(share) else min(max(share, 0.0), 1.0)


def _check(names: Sequence[str], marginals: Mapping[str, Any]) -> None:
    missing = [name for name in names if name not in marginals]
    if missing:
        raise ValueError(
            f"The tree names {', '.join(missing)[:200]}, whose failure probability was not "
            "given. Give one for each member."
        )
    for name in names:
        if not np.all((np.asarray(marginals[name]) >= 0) & (np.asarray(marginals[name]) <= 1)):
            raise ValueError(
                f"The failure probability of {name!r:.80} is {marginals[name]!r:.80}. Give "
                "numbers from 0 to 1."
            )

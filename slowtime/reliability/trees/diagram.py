"""Reduced ordered binary decision diagrams of monotone functions and set families.

A node tests one variable: whether a member has failed. Equal nodes are one node, so that a
member in several branches is counted once. Node 0 is false (or no set), node 1 is true (or the
empty set alone).

References
----------
.. [1] R. E. Bryant, "Graph-based algorithms for Boolean function manipulation", IEEE Trans.
   Computers C-35 (1986) 677-691.
.. [2] A. Rauzy, "New algorithms for fault trees analysis", Reliability Engineering and System
   Safety 40 (1993) 203-211.
"""

from collections.abc import Mapping, Sequence

from .structure import Node

MOST_STEPS = 150_000
"""Nodes and remembered results beyond which a tree is refused: about 50 MB, a second or two."""

_LAST = 1 << 60


class TooLargeTreeError(ValueError):
    """A tree whose diagram does not fit."""


class Diagram:
    """Functions and families of sets over variables 0, 1, …, tested in this order."""

    def __init__(self) -> None:
        self.variable = [_LAST, _LAST]
        self.low = [0, 1]
        self.high = [0, 1]
        self._functions: dict[tuple[int, int, int], int] = {}
        self._sets: dict[tuple[int, int, int], int] = {}
        self._either: dict[tuple[int, int], int] = {}
        self._chosen: dict[tuple[int, int, int], int] = {}
        self._minimal: dict[int, int] = {}
        self._without: dict[tuple[int, int], int] = {}
        self._closed: dict[int, int] = {}
        self._having: dict[tuple[int, int], int] = {}
        self._steps = 0

    def build(self, tree: Node, order: Mapping[str, int]) -> int:
        """Make the function that is true where a tree fails."""
        if isinstance(tree, str):
            return self._node(order[tree], 0, 1)
        inputs = [self.build(one, order) for one in tree.inputs]
        return self._at_least(tree.failures, inputs)

    def reachable(self, roots: Sequence[int]) -> list[int]:
        """All inner nodes below some, children before parents."""
        found: set[int] = set()
        waiting = list(roots)
        while waiting:
            node = waiting.pop()
            if node > 1 and node not in found:
                found.add(node)
                waiting += (self.low[node], self.high[node])
        return sorted(found)

    def minimal(self, function: int) -> int:
        """Family of the minimal sets of variables that make a monotone function true."""
        if function <= 1:
            return function
        if (known := self._minimal.get(function)) is not None:
            return known
        low, high = self.low[function], self.high[function]
        found = self._set(
            self.variable[function],
            self.minimal(low),
            self._not_within(self.minimal(high), low),
        )
        self._count()
        self._minimal[function] = found
        return found

    def containing(self, family: int, variable: int) -> int:
        """Those sets of a family that have a variable."""
        at = self.variable[family]
        if family <= 1 or at > variable:
            return 0
        if at == variable:
            return self._set(at, 0, self.high[family])
        if (known := self._having.get((family, variable))) is not None:
            return known
        found = self._set(
            at,
            self.containing(self.low[family], variable),
            self.containing(self.high[family], variable),
        )
        self._count()
        self._having[family, variable] = found
        return found

    def closure(self, family: int) -> int:
        """Make the function that is true where all of some set is true."""
        if family <= 1:
            return family
        if (known := self._closed.get(family)) is not None:
            return known
        low, high = self.closure(self.low[family]), self.closure(self.high[family])
        found = self._node(self.variable[family], low, self._or(low, high))
        self._count()
        self._closed[family] = found
        return found

    def sets(self, family: int, most: int) -> list[tuple[int, ...]]:
        """List the sets of a family, at most so many."""
        found: list[tuple[int, ...]] = []
        waiting: list[tuple[int, tuple[int, ...]]] = [(family, ())]
        while waiting and len(found) < most:
            node, chosen = waiting.pop()
            if node == 1:
                found.append(chosen)
            elif node > 1:
                waiting.append((self.low[node], chosen))
                waiting.append((self.high[node], (*chosen, self.variable[node])))
        return found

    def _at_least(self, count: int, inputs: Sequence[int]) -> int:
        """Make "at least `count` of some functions are true", from the last input on."""
        row = [1] + [0] * count
        for function in reversed(inputs):
            below = row
            row = [1] + [
                self._choose(function, below[n - 1], below[n]) for n in range(1, count + 1)
            ]
        return row[count]

    def _choose(self, test: int, yes: int, no: int) -> int:
        """If `test` then `yes` else `no`."""
        if test == 1 or yes == no:
            return yes
        if test == 0:
            return no
        if (yes, no) == (1, 0):
            return test
        key = (test, yes, no)
        if (known := self._chosen.get(key)) is not None:
            return known
        at = min(self.variable[one] for one in key)
        parts = [self._parts(one, at) for one in key]
        low = self._choose(*(part[0] for part in parts))
        high = self._choose(*(part[1] for part in parts))
        found = self._node(at, low, high)
        self._count()
        self._chosen[key] = found
        return found

    def _or(self, one: int, other: int) -> int:
        if one == other or other == 0 or one == 1:
            return one
        if one == 0 or other == 1:
            return other
        key = (one, other) if one < other else (other, one)
        if (known := self._either.get(key)) is not None:
            return known
        at = min(self.variable[one], self.variable[other])
        (low, high), (other_low, other_high) = self._parts(one, at), self._parts(other, at)
        found = self._node(at, self._or(low, other_low), self._or(high, other_high))
        self._count()
        self._either[key] = found
        return found

    def _not_within(self, family: int, function: int) -> int:
        """Those sets of a family that do not make a monotone function true."""
        if function == 1 or family == 0:
            return 0
        if function == 0 or family == 1:
            return family
        key = (family, function)
        if (known := self._without.get(key)) is not None:
            return known
        at, tested = self.variable[family], self.variable[function]
        if tested < at:
            found = self._not_within(family, self.low[function])
        else:
            low, high = self._parts(function, at)
            found = self._set(
                at,
                self._not_within(self.low[family], low),
                self._not_within(self.high[family], high),
            )
        self._count()
        self._without[key] = found
        return found

    def _parts(self, node: int, variable: int) -> tuple[int, int]:
        """Where the variable is false, and where it is true."""
        if self.variable[node] == variable:
            return self.low[node], self.high[node]
        return node, node

    def _node(self, variable: int, low: int, high: int) -> int:
        return low if low == high else self._unique_node(self._functions, (variable, low, high))

    def _set(self, variable: int, without: int, having: int) -> int:
        if having == 0:
            return without
        return self._unique_node(self._sets, (variable, without, having))

    def _unique_node(
        self, table: dict[tuple[int, int, int], int], key: tuple[int, int, int]
    ) -> int:
        known = table.get(key)
        if known is None:
            known = table[key] = len(self.variable)
            self._count()
            variable, low, high = key
            self.variable.append(variable)
            self.low.append(low)
            self.high.append(high)
        return known

    def _count(self) -> None:
        """Take one more step, or refuse."""
        self._steps += 1
        if self._steps > MOST_STEPS:
            raise TooLargeTreeError(
                "This tree is too entangled to be counted exactly: its binary decision diagram "
                f"takes more than {MOST_STEPS:,} steps. Let fewer members stand in several "
                "branches, or give gates fewer inputs."
            )

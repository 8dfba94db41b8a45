"""Degrees of freedom of a model: a node and a direction each, and where the nodes are."""

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

DIRECTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")
"""Displacements along x, y, z [m] and rotations about them [rad]; numbers 0 to 5 in arrays."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class DofMap:
    """Which node and direction each degree of freedom is.

    Parameters
    ----------
    coordinates
        Position of each node [m].
    node
        Number of the node of each degree of freedom, counted from 0.
    direction
        Direction of each degree of freedom: a position in `DIRECTIONS`.
    """

    node_names: tuple[str, ...]
    coordinates: Float[np.ndarray, "node 3"]
    node: Int[np.ndarray, " dof"]
    direction: Int[np.ndarray, " dof"]

    def __post_init__(self) -> None:
        """Refuse maps that name a node or a direction that does not exist."""
        nodes = len(self.node_names)
        if len(self.coordinates) != nodes or len(set(self.node_names)) < nodes:
            raise ValueError(
                f"{nodes} node names ({len(set(self.node_names))} different) and "
                f"{len(self.coordinates)} positions were given. Give each node one name of its "
                "own and one position."
            )
        if len(self.node) != len(self.direction):
            raise ValueError(
                f"{len(self.node)} nodes and {len(self.direction)} directions were given. Give "
                "one node and one direction for each degree of freedom."
            )
        for name, given, limit in (
            ("node", self.node, nodes),
            ("direction", self.direction, 6),
        ):
            if given.size and not (given.min() >= 0 and given.max() < limit):
                raise ValueError(
                    f"A {name} number {int(given.min())} to {int(given.max())} was given. "
                    f"Allowed are 0 to {limit - 1}."
                )
        if len(self._positions) < len(self.node):
            raise ValueError(
                f"{len(self.node) - len(self._positions)} degrees of freedom have the same "
                "node and direction as another. Give each pair once."
            )

    @property
    def size(self) -> int:
        """Number of degrees of freedom."""
        return len(self.node)

    @functools.cached_property
    def names(self) -> tuple[str, ...]:
        """Node and direction of each degree of freedom, as in `top ux`."""
        return tuple(
            f"{self.node_names[n]} {DIRECTIONS[d]}"
            for n, d in zip(self.node.tolist(), self.direction.tolist(), strict=True)
        )

    @functools.cached_property
    def _positions(self) -> dict[tuple[int, int], int]:
        pairs = zip(self.node.tolist(), self.direction.tolist(), strict=True)
        return {pair: position for position, pair in enumerate(pairs)}

    @functools.cached_property
    def _numbers(self) -> dict[str, int]:
        return {name: number for number, name in enumerate(self.node_names)}

    def find(self, node: str, direction: str) -> int:
        """Position of one degree of freedom.

        It is counted from 0. Raises `ValueError` where the model does not have it.
        """
        if node not in self._numbers or direction not in DIRECTIONS:
            raise ValueError(
                f"Node {node!r}, direction {direction!r} was given. Allowed are the model's "
                f"{len(self.node_names)} nodes, such as {self.node_names[0]!r}, and the "
                f"directions {', '.join(DIRECTIONS)}."
            )
        found = self._positions.get((self._numbers[node], DIRECTIONS.index(direction)))
        if found is None:
            raise ValueError(
                f"Node {node!r} has no degree of freedom {direction}. Choose another "
                "direction, or join an element to the node that has it."
            )
        return found

    def row(
        self, node: str, line: Mapping[str, float] | Sequence[float]
    ) -> Float[np.ndarray, " dof"]:
        """Row of a sensor that sees the displacement of a node along a line.

        The line of sight is given by direction, as in `{"ux": 0.6, "uz": 0.8}`, or along x, y
        and z; taken as it is, so that a unit vector measures in the model's unit.
        """
        parts = line if isinstance(line, Mapping) else dict(zip(DIRECTIONS, line, strict=False))
        row = np.zeros(self.size)
        for direction, value in parts.items():
            if value != 0.0:
                row[self.find(node, direction)] += value
        return row


def full_map(names: Sequence[str], coordinates: Float[np.ndarray, "node 3"]) -> DofMap:
    """Map of six degrees of freedom at each node, node by node.

    Examples
    --------
    >>> full_map(["a", "b"], np.zeros((2, 3))).names[6:8]
    ('b ux', 'b uy')
    """
    nodes = len(names)
    return DofMap(
        node_names=tuple(names),
        coordinates=coordinates,
        node=np.repeat(np.arange(nodes), 6),
        direction=np.tile(np.arange(6), nodes),
    )

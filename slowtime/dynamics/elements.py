"""Nodes and elements of a description, and their matrices."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Float

BASE = "base"
"""The node that every description has without saying so: the ground, or the shaking base."""

ROTATION = ".rotation"
"""Follows a node's id in the name of its rotation."""

NodeKind = Literal["point", "beam"]
Coordinate = Literal["translation", "rotation"]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """Where elements meet.

    Parameters
    ----------
    id
        Unique among the nodes.
    mass_kg
        Concentrated here; a point must have one, a node of a beam may.
    kind
        ``"point"`` moves along one line; ``"beam"`` also turns.
    rotary_inertia_kg_m2
        Of a beam's node only.
    held
        Coordinates of a beam's node that follow the base: ``translation`` at a pin,
        ``rotation`` at a guide.
    """

    id: str
    mass_kg: float = 0.0
    kind: NodeKind = "point"
    rotary_inertia_kg_m2: float = 0.0
    held: tuple[Coordinate, ...] = ()

    @property
    def dofs(self) -> tuple[str, ...]:
        """Names of the coordinates that are free to move."""
        names: tuple[str, ...] = () if "translation" in self.held else (self.id,)
        if self.kind == "beam" and "rotation" not in self.held:
            names += (self.id + ROTATION,)
        return names


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Spring:
    """A spring and a damper side by side, between two nodes or a node and the base.

    Parameters
    ----------
    id
        Unique among the elements.
    between
        First node, second node; `BASE` for the ground.
    stiffness_n_per_m, damping_n_s_per_m
        Of the elongation, second node minus first.
    """

    id: str
    between: tuple[str, str]
    stiffness_n_per_m: float = 0.0
    damping_n_s_per_m: float = 0.0

    @property
    def dofs(self) -> tuple[str, ...]:
        """Coordinates that the matrices speak of, in order."""
        return self.between

    def stiffness(self) -> Float[np.ndarray, "2 2"]:
        """Stiffness matrix [N/m]."""
        return self.stiffness_n_per_m * ELONGATION

    def damping(self) -> Float[np.ndarray, "2 2"]:
        """Damping matrix [N s/m]."""
        return self.damping_n_s_per_m * ELONGATION

    def mass(self) -> None:
        """Nothing: a spring has no mass of its own."""
        return


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Beam:
    r"""A uniform Euler–Bernoulli beam in bending, with cubic shape functions.

    Parameters
    ----------
    id
        Unique among the elements.
    between
        First node, second node; `BASE` clamps that end.
    length_m
        Of the element.
    bending_stiffness_n_m2
        :math:`E I`.
    mass_kg_per_m
        :math:`\rho A`; the mass matrix is the consistent one.
    damping_s
        Kelvin–Voigt: the damping matrix is the stiffness matrix times this.
    """

    id: str
    between: tuple[str, str]
    length_m: float
    bending_stiffness_n_m2: float
    mass_kg_per_m: float
    damping_s: float = 0.0

    @property
    def dofs(self) -> tuple[str, ...]:
        """Coordinates that the matrices speak of, in order."""
        first, second = self.between
        return first, first + ROTATION, second, second + ROTATION

    def stiffness(self) -> Float[np.ndarray, "4 4"]:
        """Stiffness matrix; translations in m, rotations in rad."""
        length = self.length_m
        shape = np.array(
            [
                [12, 6 * length, -12, 6 * length],
                [6 * length, 4 * length**2, -6 * length, 2 * length**2],
                [-12, -6 * length, 12, -6 * length],
                [6 * length, 2 * length**2, -6 * length, 4 * length**2],
            ]
        )
        return np.asarray(self.bending_stiffness_n_m2 / length**3 * shape)

    def damping(self) -> Float[np.ndarray, "4 4"]:
        """Damping matrix."""
        return self.damping_s * self.stiffness()

    def mass(self) -> Float[np.ndarray, "4 4"]:
        """Consistent mass matrix."""
        length = self.length_m
        shape = np.array(
            [
                [156, 22 * length, 54, -13 * length],
                [22 * length, 4 * length**2, 13 * length, -3 * length**2],
                [54, 13 * length, 156, -22 * length],
                [-13 * length, -3 * length**2, -22 * length, 4 * length**2],
            ]
        )
        return np.asarray(self.mass_kg_per_m * length / 420 * shape)


Element = Spring | Beam
ELONGATION = np.array([[1.0, -1.0], [-1.0, 1.0]])

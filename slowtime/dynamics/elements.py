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
class OpenJoint(Spring):
    """Two points that nothing joins in the model, between which something may act.

    It has neither stiffness nor damping: a diagnosis puts effects on it, as on an element.

    Parameters
    ----------
    among
        How many such pairs the model has.
    """

    among: int = 1


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Beam:
    r"""A uniform Euler–Bernoulli beam in bending, with cubic shape functions.

    Parameters
    ----------
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


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Matrix:
    """Dense matrices over some coordinates: a reduced substructure, or a part of it.

    Parameters
    ----------
    coordinates
        Names of the coordinates: nodes, or nodes and `ROTATION`.
    stiffness_terms, mass_terms, damping_terms
        Lower triangles of the matrices, row by row, as the bytes of little-endian numbers of 64
        bits (see `packed`); empty for zero.
    stiffness_factor, mass_factor, damping_factor
        What each matrix is multiplied by [1].
    exact
        Whether these factors are known without error, whatever the tolerance of the model.
    """

    id: str
    coordinates: tuple[str, ...]
    stiffness_terms: bytes = b""
    mass_terms: bytes = b""
    damping_terms: bytes = b""
    stiffness_factor: float = 1.0
    mass_factor: float = 1.0
    damping_factor: float = 1.0
    exact: bool = False

    @property
    def between(self) -> tuple[str, ...]:
        """Nodes that it joins."""
        nodes = (name.removesuffix(ROTATION) for name in self.coordinates)
        return tuple(dict.fromkeys(nodes))

    @property
    def dofs(self) -> tuple[str, ...]:
        """Coordinates that the matrices speak of, in order."""
        return self.coordinates

    def stiffness(self) -> Float[np.ndarray, "own own"]:
        """Stiffness matrix [N/m]."""
        return self.stiffness_factor * self._whole(self.stiffness_terms)

    def damping(self) -> Float[np.ndarray, "own own"]:
        """Damping matrix [N s/m]."""
        return self.damping_factor * self._whole(self.damping_terms)

    def mass(self) -> Float[np.ndarray, "own own"]:
        """Mass matrix [kg]."""
        return self.mass_factor * self._whole(self.mass_terms)

    def _whole(self, terms: bytes) -> Float[np.ndarray, "own own"]:
        size = len(self.coordinates)
        whole = np.zeros((size, size))
        if terms:
            rows, columns = np.tril_indices(size)
            whole[rows, columns] = whole[columns, rows] = np.frombuffer(terms, "<f8")
        return whole


def packed(matrix: Float[np.ndarray, "own own"]) -> bytes:
    """Lower triangle of a symmetric matrix as bytes; none of a matrix of zeros.

    The terms are those of a `Matrix`.
    """
    if not matrix.any():
        return b""
    return np.ascontiguousarray(matrix[np.tril_indices(len(matrix))], "<f8").tobytes()


Element = Spring | Beam | Matrix
ELONGATION = np.array([[1.0, -1.0], [-1.0, 1.0]])

"""Description of a frame, truss or shell in space: nodes, elements, supports, parameters."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Float

from .sections import Material, Section, Theory

Direction = Literal["ux", "uy", "uz", "rx", "ry", "rz"]
Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """A straight element with an axial force only, hinged at both ends.

    Parameters
    ----------
    group
        Name under which a parameter scales it; empty for none.
    """

    name: str
    ends: tuple[str, str]
    section: Section
    material: Material
    group: str = ""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Beam:
    """A straight, uniform beam, rigidly joined to its nodes but for what is released.

    Parameters
    ----------
    theory
        `euler` neglects shear deformation and rotary inertia, `timoshenko` has both.
    orientation
        A vector in the plane of the local x and y axes; see `line_elements.element_axes`.
    group
        Name under which a parameter scales it; empty for none.
    released
        Directions along and about the local axes in which the first and the second end pass
        no force to their nodes, such as ``("rz",)`` for a hinge.
    """

    name: str
    ends: tuple[str, str]
    section: Section
    material: Material
    theory: Theory = "timoshenko"
    orientation: Vector = ZERO
    group: str = ""
    released: tuple[tuple[Direction, ...], tuple[Direction, ...]] = ((), ())


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Spring:
    """Springs along and about the global axes, between two nodes or a node and the ground.

    They sit at the second node; the first node reaches them by a rigid arm, so that a motion
    of the whole as a rigid body strains nothing.

    Parameters
    ----------
    translation_n_per_m, rotation_nm_per_rad
        Stiffnesses along [N/m] and about [N m/rad] x, y and z.
    group
        Name under which a parameter scales it; empty for none.
    """

    name: str
    ends: tuple[str | None, str]
    translation_n_per_m: Vector = ZERO
    rotation_nm_per_rad: Vector = ZERO
    group: str = ""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class PointMass:
    """A rigid body attached to a node.

    Parameters
    ----------
    inertia_kg_m2
        Moments of inertia about x, y and z through its centre [kg m^2].
    offset_m
        From the node to its centre [m].
    group
        Name under which a parameter scales it; empty for none.
    """

    name: str
    node: str
    mass_kg: float
    inertia_kg_m2: Vector = ZERO
    offset_m: Vector = ZERO
    group: str = ""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Shell:
    """A flat, uniform shell of four corners, with bending, shear deformation and membrane.

    Parameters
    ----------
    corners
        Name of the element and of its four nodes, in order around it.
    group
        Name under which a parameter scales it; empty for none.
    """

    name: str
    corners: tuple[str, str, str, str]
    thickness_m: float
    material: Material
    group: str = ""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Support:
    """Directions in which a node is held."""

    node: str
    directions: tuple[Direction, ...] = ("ux", "uy", "uz", "rx", "ry", "rz")


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class RigidLink:
    """A node that moves with another as if both were on one rigid body."""

    leading: str
    following: str


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class MultiPointConstraint:
    """A linear relation, sum of coefficient times displacement = 0.

    The first term is eliminated, so no other relation may begin with the same one.
    """

    terms: tuple[tuple[str, Direction, float], ...]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One parameter: a relative change of the stiffness, mass or both of some groups."""

    name: str
    groups: tuple[str, ...]
    acts_on: Literal["stiffness", "mass", "both"] = "stiffness"


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """A frame or truss of nodes, elements, supports and parameters.

    Parameters
    ----------
    node_names, coordinates
        Name and position of each node [m].
    bars, beams, springs, masses, shells
        Elements.
    supports, links, constraints
        Conditions on the displacements.
    parameters
        What may change.
    """

    node_names: tuple[str, ...]
    coordinates: Float[np.ndarray, "node 3"]
    bars: tuple[Bar, ...] = ()
    beams: tuple[Beam, ...] = ()
    springs: tuple[Spring, ...] = ()
    masses: tuple[PointMass, ...] = ()
    shells: tuple[Shell, ...] = ()
    supports: tuple[Support, ...] = ()
    links: tuple[RigidLink, ...] = ()
    constraints: tuple[MultiPointConstraint, ...] = ()
    parameters: tuple[Parameter, ...] = ()

    def __post_init__(self) -> None:
        """Refuse names that occur twice or do not exist."""
        lines: tuple[Bar | Beam | Spring, ...] = (*self.bars, *self.beams, *self.springs)
        elements: tuple[Bar | Beam | Spring | PointMass | Shell, ...] = (
            *lines,
            *self.masses,
            *self.shells,
        )
        _check_unique("node", self.node_names)
        _check_unique("element", tuple(element.name for element in elements))
        known = set(self.node_names)
        for line in lines:
            _check_known(
                line.name, [end for end in line.ends if end is not None], known, "node"
            )
        for mass in self.masses:
            _check_known(mass.name, [mass.node], known, "node")
        for shell in self.shells:
            _check_known(shell.name, list(shell.corners), known, "node")
        groups = {element.group for element in elements} - {""}
        for parameter in self.parameters:
            _check_known(parameter.name, list(parameter.groups), groups, "group")


def _check_unique(what: str, names: tuple[str, ...]) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise ValueError(f"Two of the {what}s are named {name!r}. Give each its own name.")
        seen.add(name)


def _check_known(owner: str, names: list[str], known: set[str], what: str) -> None:
    for name in names:
        if name not in known:
            raise ValueError(
                f"{owner!r} names the {what} {name!r}, which does not exist. Allowed are the "
                f"{len(known)} {what}s of the frame, such as {min(known, default='none')!r}."
            )

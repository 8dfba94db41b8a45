"""Descriptions of structures, and the matrices assembled from them."""

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from .channels import IMPOSED_KINDS, DescriptionError, Input, Sensor, Start, Support
from .channels.checks import (
    check_inputs,
    check_known,
    check_sensors,
    check_start,
    check_supports,
    check_unique,
)
from .elements import BASE, ROTATION, Beam, Element, Matrix, Node, OpenJoint, Spring
from .structure import Structure
from .units import UnitOfCoordinate

__all__ = [
    "BASE",
    "Beam",
    "Description",
    "DescriptionError",
    "Element",
    "Input",
    "Matrix",
    "Node",
    "OpenJoint",
    "Parts",
    "Sensor",
    "Spring",
    "Start",
    "Support",
    "Tolerance",
    "assemble",
    "assemble_parts",
    "moves_with_base",
]

Square = Float[np.ndarray, "dof dof"]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """Relative standard deviation of what the description claims."""

    stiffness: float = 0.0
    damping: float = 0.0
    mass: float = 0.0


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Description:
    """Nodes and elements, what shakes them and what listens.

    Parameters
    ----------
    effects
        What the linear elements lack, as diagnosis names it; carried along, not assembled.
    inputs
        None for a structure under ambient forces that nobody measures.
    tolerance
        None where nothing is claimed.
    unit_of_coordinate
        ``"rad"`` makes every length an angle, every force a torque, every mass an inertia.
    supports
        Points beside the base that elements end at, and that inputs may move.
    initial
        Motion of nodes when a simulation begins; a diagnosis estimates the start of each
        record instead.

    Raises
    ------
    DescriptionError
        Where a node is spoken of that does not exist, a name is used twice, a unit does not
        fit its quantity, or a part cannot be what it says.

    Examples
    --------
    >>> spring = Spring(id="k1", between=(BASE, "m1"), stiffness_n_per_m=8.0)
    >>> swing = Description(name="one", nodes=(Node(id="m1", mass_kg=2.0),), elements=(spring,))
    >>> assemble(swing).stiffness
    array([[8.]])
    """

    name: str
    nodes: tuple[Node, ...]
    elements: tuple[Element, ...]
    effects: tuple[Mapping[str, Any], ...] = ()
    inputs: tuple[Input, ...] = ()
    sensors: tuple[Sensor, ...] = ()
    tolerance: Tolerance | None = None
    unit_of_coordinate: UnitOfCoordinate = "m"
    supports: tuple[Support, ...] = ()
    initial: tuple[Start, ...] = ()

    def __post_init__(self) -> None:
        _check_nodes(self)
        check_supports(self.supports, self.nodes)
        _check_elements(self)
        check_inputs(self.inputs, self.nodes, self.supports, self.unit_of_coordinate)
        check_sensors(
            self.sensors, self.nodes, self.elements, self.moved, self.unit_of_coordinate
        )
        check_start(self.initial, self.dofs)

    @property
    def dofs(self) -> tuple[str, ...]:
        """Names of the degrees of freedom, in the order of the nodes."""
        moved = self.moved
        return tuple(name for node in self.nodes if node.id not in moved for name in node.dofs)

    @property
    def moved(self) -> tuple[str, ...]:
        """Supports, and nodes that are driven: what moves as inputs say, or with the base."""
        supports = [one.id for one in self.supports]
        driven = [e.node for e in self.inputs if e.kind in IMPOSED_KINDS and e.node]
        return tuple(dict.fromkeys((*supports, *driven)))


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Parts:
    r"""What each node and element contributes, so that :math:`K = \sum_e (1 + \theta_e) K_e`.

    Parameters
    ----------
    mass_parts
        By node, and by beam for the mass spread along it.
    damping_parts, stiffness_parts
        By element; elements without damping or stiffness are left out.
    """

    names: tuple[str, ...]
    mass_parts: Mapping[str, Square]
    damping_parts: Mapping[str, Square]
    stiffness_parts: Mapping[str, Square]


def assemble(description: Description) -> Structure:
    """Matrices of a description, in coordinates relative to the base."""
    free = len(description.dofs)
    whole = {what: np.zeros((free + 1, free + 1)) for what in ("mass", "damping", "stiffness")}
    for what, _, matrix in _contributions(description):
        whole[what] += matrix
    return Structure(
        mass=whole["mass"][:free, :free],
        damping=whole["damping"][:free, :free],
        stiffness=whole["stiffness"][:free, :free],
        names=description.dofs,
        influence=np.array([not name.endswith(ROTATION) for name in description.dofs], float),
        base_mass=whole["mass"][:free, free],
    )


def assemble_parts(description: Description) -> Parts:
    """Matrices of each node and element of a description by itself."""
    parts: dict[str, dict[str, Square]] = {"mass": {}, "damping": {}, "stiffness": {}}
    for what, name, matrix in _contributions(description):
        if matrix[:-1, :-1].any():
            parts[what][name] = matrix[:-1, :-1]
    return Parts(
        names=description.dofs,
        mass_parts=parts["mass"],
        damping_parts=parts["damping"],
        stiffness_parts=parts["stiffness"],
    )


def _contributions(
    description: Description,
) -> Iterator[tuple[str, str, Float[np.ndarray, "all all"]]]:
    """Give what every node and element adds; last row and column are of the base moving."""
    place = places(description)
    size = len(description.dofs) + 1
    for node in description.nodes:
        names = (node.id, node.id + ROTATION)[: 1 + (node.kind == "beam")]
        own = np.diag([node.mass_kg, node.rotary_inertia_kg_m2][: len(names)])
        yield "mass", node.id, spread(own, names, place, size)
    for element in description.elements:
        mass = element.mass()
        if mass is not None:
            yield "mass", element.id, spread(mass, element.dofs, place, size)
        yield "damping", element.id, spread(element.damping(), element.dofs, place, size)
        yield "stiffness", element.id, spread(element.stiffness(), element.dofs, place, size)


def moves_with_base(description: Description) -> bool:
    """Whether it is known what a motion of the base does to every part."""
    # Reduced substructures are loaded by it where one of their matrices has the base among its
    # coordinates.
    matrices = [part for part in description.elements if isinstance(part, Matrix)]
    return not matrices or any(BASE in part.coordinates for part in matrices)


def places(description: Description) -> dict[str, int | None]:
    """Row of each coordinate: the base's row for those held to it, None where held at zero."""
    base = len(description.dofs)
    place: dict[str, int | None] = {BASE: base, BASE + ROTATION: None}
    place |= {support.id: base for support in description.supports}
    for node in description.nodes:
        place |= {node.id: base, node.id + ROTATION: None}
    return place | {name: row for row, name in enumerate(description.dofs)}


def spread(
    matrix: Float[np.ndarray, "own own"],
    names: Iterable[str],
    place: Mapping[str, int | None],
    size: int,
) -> Float[np.ndarray, "all all"]:
    """Expand a part's own matrix to the coordinates of the whole structure.

    `place` gives the row of each coordinate in the whole; None for one that is left out.
    """
    rows = [place[name] for name in names]
    to = np.zeros((len(rows), size))
    for own, row in enumerate(rows):
        if row is not None:
            to[own, row] = 1.0
    return np.asarray(to.T @ matrix @ to)


def _check_nodes(description: Description) -> None:
    if not description.nodes:
        raise DescriptionError(("nodes",), "There are no nodes. Give at least one.")
    check_unique("nodes", [node.id for node in description.nodes], "id")
    for i, node in enumerate(description.nodes):
        if node.id == BASE:
            raise DescriptionError(
                ("nodes", i, "id"),
                f"{BASE!r} is the ground, which every model has. Call the node something else.",
            )
        if node.kind == "point" and not node.mass_kg > 0:
            raise DescriptionError(
                ("nodes", i, "mass_kg"),
                f"Node {node.id!r} has a mass of {node.mass_kg} kg. Give a point a positive "
                "mass, or join its two elements into one.",
            )
        if node.kind == "point" and (node.held or node.rotary_inertia_kg_m2):
            raise DescriptionError(
                ("nodes", i, "held" if node.held else "rotary_inertia_kg_m2"),
                f"Node {node.id!r} is a point mass, which has no rotation and no support. "
                "Write `kind: beam`, or leave the entry out.",
            )
    if not description.dofs and not description.moved:
        raise DescriptionError(("nodes",), "All nodes are held: nothing can move. Free one.")


def _check_elements(description: Description) -> None:
    check_unique("elements", [element.id for element in description.elements], "id")
    kinds = {node.id: node.kind for node in description.nodes} | {BASE: "beam"}
    kinds |= {support.id: "point" for support in description.supports}
    for i, element in enumerate(description.elements):
        where = ("elements", i, "between")
        for node in element.between:
            check_known(where, node, kinds)
            if isinstance(element, Beam) and kinds[node] != "beam":
                raise DescriptionError(
                    where,
                    f"Beam {element.id!r} ends at {node!r}, a point mass, which has no "
                    "rotation. Write `kind: beam` at the node; a support takes springs "
                    "alone.",
                )
        if len(set(element.between)) < 2:
            raise DescriptionError(
                where,
                f"Element {element.id!r} joins {element.between[0]!r} to itself. Name two "
                "different nodes.",
            )
        if not isinstance(element, Spring):
            _check_masses(description, i, element)
        if isinstance(element, Matrix):
            _check_matrix(description, i, element)
    joined = {end for element in description.elements for end in element.between}
    for i, name in enumerate(node.id for node in description.nodes):
        if description.elements and name not in joined:
            raise DescriptionError(
                ("nodes", i, "id"),
                f"Node {name!r} hangs in the air: no element ends at it. Add the one that "
                "holds it, with a stiffness of 0 where it moves freely, or leave it out.",
            )


def _check_masses(description: Description, i: int, element: Beam | Matrix) -> None:
    word = "Beam" if isinstance(element, Beam) else "Matrix"
    if description.unit_of_coordinate == "rad":
        raise DescriptionError(
            ("elements", i, "kind"),
            f"{word} {element.id!r} bends in metres, but unit_of_coordinate is rad. Use "
            "springs.",
        )
    if any(node.id == element.id for node in description.nodes):
        raise DescriptionError(
            ("elements", i, "id"),
            f"{word} and node are both called {element.id!r}, so that their masses could not "
            "be told apart. Rename one.",
        )


def _check_matrix(description: Description, i: int, element: Matrix) -> None:
    place = places(description)
    for name in element.coordinates:
        if place.get(name) is None:
            raise DescriptionError(
                ("elements", i, "coordinates"),
                f"Matrix {element.id!r} speaks of {name!r}, which no node moves by. Allowed: "
                f"{', '.join(description.dofs)} and {BASE}.",
            )
    if len(set(element.coordinates)) < len(element.coordinates):
        raise DescriptionError(
            ("elements", i, "coordinates"),
            f"Matrix {element.id!r} names a coordinate twice. Name each once.",
        )
    count = len(element.coordinates)
    for terms in (element.stiffness_terms, element.mass_terms, element.damping_terms):
        if len(terms) not in (0, 4 * count * (count + 1)):
            raise DescriptionError(
                ("elements", i, "coordinates"),
                f"Matrix {element.id!r} has {len(terms) / 8:g} terms. Allowed is none, or the "
                f"{count * (count + 1) // 2} of a triangle over {count} coordinates.",
            )

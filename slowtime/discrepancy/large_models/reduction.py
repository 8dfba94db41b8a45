"""Reduced description of a large model: points that are kept, modes, and main directions.

Its elements are the parts that are kept as they are, one matrix for the rest, and one for each
direction of constants, whose factor is 1 within the tolerance of its kind. So it is a model
like any other, of few coordinates and few constants.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.localization.linear_response import LinearModel, parameter_matrices
from slowtime.dynamics.channels import BASE_KINDS
from slowtime.dynamics.description import (
    BASE,
    Description,
    Matrix,
    Node,
    OpenJoint,
    Spring,
    assemble_parts,
)
from slowtime.dynamics.elements import ROTATION, Element, packed
from slowtime.dynamics.plant import Name, Plant
from slowtime.dynamics.structure import Structure

from .basis import BandModes, Basis
from .constants import ORDERS, Constant, Directions

REST = "rest of the model"
"""Name of the matrix that holds what no other element of a reduced description does."""
MODE = "mode"
"""Names of the generalized coordinates begin so."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Kept:
    """Parts of a large model that a reduced one keeps as they are.

    Parameters
    ----------
    nodes
        Names of nodes, beside those of sensors, inputs, effects and these elements.
    joints
        Pairs of points that nothing joins, between which something may act.
    """

    elements: tuple[str, ...] = ()
    nodes: tuple[str, ...] = ()
    joints: tuple[OpenJoint, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ReducedModel:
    """A large model and its reduced description.

    Parameters
    ----------
    basis
        Motion of the large model's coordinates, by those of the reduced one.
    fitted
        Constants of the large model where a fit of them ended.
    """

    large: Description
    small: Description
    basis: Basis
    directions: Mapping[str, Directions]
    fitted: Mapping[Name, float] = dataclasses.field(default_factory=dict)

    def fitted_values(self, plant: Plant) -> Float[np.ndarray, " parameter"]:
        """Values of a plant of the reduced description at the constants that were fitted."""
        own: dict[Name, float] = dict(self.fitted)
        stated = constant_values(self.large)
        for what, directions in self.directions.items():
            changes = [
                self.fitted[name] / stated[name] - 1 if stated[name] else 0.0
                for name in directions.constants
            ]
            factors = 1 + directions.mixture.T @ np.array(changes)
            own |= {(what, f"{what} direction {i + 1}"): f for i, f in enumerate(factors)}
        before = zip(plant.parameters, plant.values.tolist(), strict=True)
        return np.array([own.get(name, value) for name, value in before])

    def constants_at(self, small: Description) -> dict[Name, float]:
        """Values of the large model's constants at those of a reduced description."""
        own: dict[Name, float] = {}
        for part in small.elements:
            if isinstance(part, Spring) and not isinstance(part, OpenJoint):
                own["stiffness", part.id] = part.stiffness_n_per_m
                own["damping", part.id] = part.damping_n_s_per_m
        own |= {("mass", node.id): node.mass_kg for node in small.nodes if node.mass_kg}
        stated = constant_values(self.large)
        for what, directions in self.directions.items():
            factors = np.array(
                [
                    getattr(part, f"{what}_factor")
                    for part in small.elements
                    if isinstance(part, Matrix) and part.id.startswith(f"{what} direction ")
                ]
            )
            for name, change in directions.changes(factors).items():
                own[name] = stated[name] * (1 + change)
        return own

    def enlarged(self, small: Description) -> Description:
        """Give the large model with the constants and effects of a reduced description."""
        whole = with_values(self.large, self.constants_at(small))
        known = {part.id for part in self.large.elements}
        used = {effect["element"] for effect in small.effects if "element" in effect}
        added = tuple(
            part
            for part in small.elements
            if isinstance(part, Spring) and part.id not in known and part.id in used
        )
        return dataclasses.replace(
            whole, elements=(*whole.elements, *added), effects=small.effects
        )


def constant_values(description: Description) -> dict[Constant, float]:
    """Values of the constants of a description."""
    found: dict[Constant, float] = {}
    for part in description.elements:
        if isinstance(part, Spring):
            found["stiffness", part.id] = part.stiffness_n_per_m
            found["damping", part.id] = part.damping_n_s_per_m
        elif isinstance(part, Matrix):
            found |= {(what, part.id): getattr(part, f"{what}_factor") for what in ORDERS}
        else:
            found["stiffness", part.id] = part.bending_stiffness_n_m2
            found["damping", part.id] = part.damping_s
            found["mass", part.id] = part.mass_kg_per_m
    return found | {("mass", node.id): node.mass_kg for node in description.nodes}


def reduce_model(
    large: Description,
    modes: BandModes,
    directions: Mapping[str, Directions],
    kept: Kept = Kept(),
) -> ReducedModel:
    """Reduce a model to its band, the points that are kept, and main directions."""
    points = kept_points(large, kept)
    linear = LinearModel.of(large)
    driven = any(entry.kind in BASE_KINDS for entry in large.inputs)
    loads = linear.base_force()[:, None] if driven else np.zeros((linear.structure.dofs, 0))
    basis = modes.basis(points, loads)
    inner = tuple(f"{MODE} {i + 1}" for i in range(basis.shape[1] - len(points)))
    coordinates = (*points, *(name + ROTATION for name in inner))
    masses = {node.id: node.mass_kg for node in large.nodes}
    own = [e for e in large.elements if e.id in kept.elements]
    parts = _direction_matrices(large, basis, coordinates, directions)
    nodes = [
        Node(id=name, kind="beam", held=("rotation",), mass_kg=masses[name]) for name in points
    ]
    # A generalized coordinate is written as the turning of a node that is held in place.
    nodes += [Node(id=name, kind="beam", held=("translation",)) for name in inner]
    empty = Matrix(id=REST, coordinates=coordinates)
    bare = dataclasses.replace(
        large, nodes=tuple(nodes), elements=(*own, *kept.joints, empty, *parts), initial=()
    )
    rest = _rest(linear.structure, basis, bare, coordinates, driven=driven)
    small = dataclasses.replace(bare, elements=(*own, *kept.joints, rest, *parts))
    return ReducedModel(large, small, basis, directions)


def kept_points(large: Description, kept: Kept) -> list[str]:
    """Name the coordinates that are kept, each once."""
    elements = {element.id: element.between for element in large.elements}
    names = [*(entry.node for entry in large.inputs), *(one.node for one in large.sensors)]
    names += [effect.get("node") for effect in large.effects]
    used = [effect["element"] for effect in large.effects if "element" in effect]
    names += [end for one in (*kept.elements, *used) for end in elements[one]]
    names += [*(end for joint in kept.joints for end in joint.between), *kept.nodes]
    own = set(large.dofs)
    return [name for name in dict.fromkeys(names) if name in own]


def _direction_matrices(
    large: Description,
    basis: Basis,
    coordinates: tuple[str, ...],
    directions: Mapping[str, Directions],
) -> list[Element]:
    """Give one matrix for each direction of constants."""
    units = parameter_matrices(large)
    found: list[Element] = []
    for what, one in directions.items():
        projected = np.array([_projected(units[name], basis) for name in one.constants])
        for i, matrix in enumerate(np.tensordot(one.mixture.T, projected, axes=1)):
            terms: dict[str, Any] = {f"{what}_terms": packed(matrix)}
            plain = Matrix(id=f"{what} direction {i + 1}", coordinates=coordinates)
            found.append(dataclasses.replace(plain, **terms))
    return found


def _projected(part: Float[np.ndarray, "dof dof"], basis: Basis) -> np.ndarray:
    rows = np.flatnonzero(part.any(axis=0))
    return np.asarray(basis[rows].T @ part[np.ix_(rows, rows)] @ basis[rows])


def _rest(
    structure: Structure,
    basis: Basis,
    bare: Description,
    coordinates: Sequence[str],
    *,
    driven: bool,
) -> Matrix:
    """Give what a reduced description without it lacks, as one matrix."""
    has = assemble_parts(bare)
    stiffness = basis.T @ structure.stiffness @ basis - sum(has.stiffness_parts.values())
    damping = basis.T @ structure.damping @ basis - sum(has.damping_parts.values())
    whole = basis.T @ structure.mass @ basis
    mass = whole - sum(has.mass_parts.values())
    if driven:
        carried = np.array([not name.endswith(ROTATION) for name in coordinates], float)
        column = -(structure.base_force(np.ones(1))[0] @ basis) - whole @ carried
        mass = np.block([[mass, column[:, None]], [column[None], np.zeros((1, 1))]])
        stiffness, damping = (np.pad(one, ((0, 1), (0, 1))) for one in (stiffness, damping))
        coordinates = (*coordinates, BASE)
    return Matrix(
        id=REST, coordinates=tuple(coordinates), stiffness_terms=packed(stiffness),
        damping_terms=packed(damping), mass_terms=packed(mass), exact=True,
    )  # fmt: skip

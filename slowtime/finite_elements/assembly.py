"""Assembly of frames into sparse matrices with parameters."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from . import line_elements as lines
from . import shell_elements as plates
from .constraints import (
    carried_by,
    constrain,
    constraint_equations,
    link_equations,
    project_sparse,
    support_equations,
)
from .degrees_of_freedom import DIRECTIONS, DofMap, full_map
from .frame import Bar, Beam, Frame, Parameter, PointMass, Shell, Spring
from .parametric_matrices import ParametricMatrices


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ElementMatrices:
    """Matrices of elements of one kind in global directions.

    Parameters
    ----------
    nodes
        Numbers of the nodes of each element; -1 for the ground.
    stiffness, mass
        Over six degrees of freedom of each of its nodes.
    """

    nodes: Int[np.ndarray, "element corner"]
    stiffness: Float[np.ndarray, "element own own"]
    mass: Float[np.ndarray, "element own own"]
    groups: tuple[str, ...]


def assemble(frame: Frame) -> ParametricMatrices:
    """Sparse stiffness and mass of a frame, with one part for each of its parameters.

    Rotations of nodes that only bars join have neither stiffness nor mass, and are left out
    unless a constraint needs them.

    Raises `ValueError` where an element has no length, or the conditions contradict each other.
    """
    kinds = element_matrices(frame)
    whole = full_map(frame.node_names, frame.coordinates)
    size = whole.size
    model = ParametricMatrices(
        stiffness=_scattered(kinds, size, "stiffness", None),
        mass=_scattered(kinds, size, "mass", None),
        names=tuple(parameter.name for parameter in frame.parameters),
        stiffness_parts=tuple(_part(kinds, size, "stiffness", one) for one in frame.parameters),
        mass_parts=tuple(_part(kinds, size, "mass", one) for one in frame.parameters),
        dofs=whole,
    )
    return _conditioned(frame, model, whole)


def whole_mass(frame: Frame) -> sparse.csr_array:
    """Mass over six degrees of freedom at each node, before supports and constraints.

    Times a unit motion of all nodes it is the load of a moving base.
    """
    size = full_map(frame.node_names, frame.coordinates).size
    return _scattered(element_matrices(frame), size, "mass", None)


def element_matrices(frame: Frame) -> list[ElementMatrices]:
    """Matrices of all elements of a frame, kind by kind."""
    number = {name: i for i, name in enumerate(frame.node_names)}
    makers: list[tuple[Sequence[object], Callable[..., ElementMatrices]]] = [
        (frame.bars, _bars),
        (frame.beams, _beams),
        (frame.springs, _springs),
        (frame.masses, _masses),
        (frame.shells, _shells),
    ]
    return [make(given, number, frame.coordinates) for given, make in makers if given]


def _conditioned(frame: Frame, model: ParametricMatrices, whole: DofMap) -> ParametricMatrices:
    equations = [
        *support_equations(whole, frame.supports),
        *link_equations(whole, frame.links),
        *constraint_equations(whole, frame.constraints),
    ]
    done = constrain(model, equations)
    busy = (np.diff(done.stiffness.indptr) > 0) | (np.diff(done.mass.indptr) > 0)
    if busy.all():
        return done
    columns = np.flatnonzero(busy)
    pick = sparse.csr_array(
        (np.ones(len(columns)), (columns, range(len(columns)))), shape=(done.size, len(columns))
    )
    expansion = pick if done.expansion is None else sparse.csr_array(done.expansion @ pick)
    return project_sparse(done, pick, expansion)


def _part(
    kinds: list[ElementMatrices], size: int, what: str, parameter: Parameter
) -> sparse.csr_array | None:
    if parameter.acts_on not in (what, "both"):
        return None
    return _scattered(kinds, size, what, frozenset(parameter.groups))


def _scattered(
    kinds: list[ElementMatrices], size: int, what: str, groups: frozenset[str] | None
) -> sparse.csr_array:
    """Sum of element matrices, of all or of some groups, without entries that are zero."""
    rows, columns, values = [], [], []
    for kind in kinds:
        chosen = np.array([groups is None or group in groups for group in kind.groups])
        matrices, nodes = getattr(kind, what)[chosen], kind.nodes[chosen]
        where = (6 * nodes[:, :, None] + np.arange(6)).reshape(len(nodes), 6 * nodes.shape[1])
        where[np.repeat(nodes < 0, 6, axis=1)] = -1
        row, column = np.broadcast_arrays(where[:, :, None], where[:, None, :])
        held = (row >= 0) & (column >= 0) & (matrices != 0.0)
        rows.append(row[held])
        columns.append(column[held])
        values.append(matrices[held])
    if not rows:
        return sparse.csr_array((size, size))
    places = (np.concatenate(rows), np.concatenate(columns))
    return sparse.csr_array((np.concatenate(values), places), shape=(size, size))


def _line(
    elements: Sequence[Bar | Beam], number: dict[str, int], coordinates: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    nodes = np.array([[number[one.ends[0]], number[one.ends[1]]] for one in elements])
    along = coordinates[nodes[:, 1]] - coordinates[nodes[:, 0]]
    orientation = np.array([getattr(one, "orientation", (0.0, 0.0, 0.0)) for one in elements])
    axes = lines.element_axes(along, orientation)
    return nodes, np.linalg.norm(along, axis=1), axes


def _bars(
    elements: Sequence[Bar], number: dict[str, int], coordinates: np.ndarray
) -> ElementMatrices:
    nodes, length, axes = _line(elements, number, coordinates)
    area = np.array([one.section.area_m2 for one in elements])
    young = np.array([one.material.young_pa for one in elements])
    density = np.array([one.material.density_kg_m3 for one in elements])
    zero, none = np.zeros((len(elements), 2, 2)), np.zeros((len(elements), 4, 4))
    local = lines.beam_matrix(lines.spring_pair(young * area / length), zero, none, none)
    return ElementMatrices(
        nodes,
        lines.to_global(local, axes),
        lines.bar_mass(density * area, length),
        tuple(one.group for one in elements),
    )


def _beams(
    elements: Sequence[Beam], number: dict[str, int], coordinates: np.ndarray
) -> ElementMatrices:
    nodes, length, axes = _line(elements, number, coordinates)
    section = {
        name: np.array([getattr(one.section, name) for one in elements])
        for name in ("area_m2", "inertia_y_m4", "inertia_z_m4", "torsion_m4")
    }
    young = np.array([one.material.young_pa for one in elements])
    shear = np.array([one.material.shear_pa for one in elements])
    density = np.array([one.material.density_kg_m3 for one in elements])
    thick = np.array([one.theory == "timoshenko" for one in elements])
    line_mass = density * section["area_m2"]
    bent_k, bent_m = [], []
    for inertia, side in (("inertia_z_m4", "shear_y_m2"), ("inertia_y_m4", "shear_z_m2")):
        bending = young * section[inertia]
        area = np.array([getattr(one.section, side) for one in elements])
        ratio = lines.shear_ratio(bending, np.where(thick, shear * area, np.inf), length)
        rotary = np.where(thick, density * section[inertia], 0.0)
        bent_k.append(lines.bending_stiffness(bending, ratio, length))
        bent_m.append(lines.bending_mass(line_mass, rotary, ratio, length))
    polar = density * (section["inertia_y_m4"] + section["inertia_z_m4"])
    stiffness = lines.beam_matrix(
        lines.spring_pair(young * section["area_m2"] / length),
        lines.spring_pair(shear * section["torsion_m4"] / length),
        *bent_k,
    )
    mass = lines.beam_matrix(
        lines.linear_mass(line_mass, length), lines.linear_mass(polar, length), *bent_m
    )
    for k, one in enumerate(elements):
        loose = [6 * end + DIRECTIONS.index(way) for end in (0, 1) for way in one.released[end]]
        if loose:
            try:
                stiffness[k], mass[k] = lines.released(stiffness[k], mass[k], np.array(loose))
            except ValueError as error:
                raise ValueError(f"Beam {one.name!r} {error}") from None
    groups = tuple(one.group for one in elements)
    return ElementMatrices(
        nodes, lines.to_global(stiffness, axes), lines.to_global(mass, axes), groups
    )


def _springs(
    elements: Sequence[Spring], number: dict[str, int], coordinates: np.ndarray
) -> ElementMatrices:
    nodes = np.array(
        [
            [-1 if one.ends[0] is None else number[one.ends[0]], number[one.ends[1]]]
            for one in elements
        ]
    )
    stiffness = np.zeros((len(elements), 12, 12))
    for i, one in enumerate(elements):
        strain = np.zeros((6, 12))
        strain[:, 6:] = np.eye(6)
        if nodes[i, 0] >= 0:
            strain[:, :6] = -carried_by(coordinates[nodes[i, 1]] - coordinates[nodes[i, 0]])
        springs = np.array([*one.translation_n_per_m, *one.rotation_nm_per_rad])
        stiffness[i] = strain.T @ (springs[:, None] * strain)
    groups = tuple(one.group for one in elements)
    return ElementMatrices(nodes, stiffness, np.zeros_like(stiffness), groups)


def _masses(
    elements: Sequence[PointMass], number: dict[str, int], coordinates: np.ndarray
) -> ElementMatrices:
    mass = np.zeros((len(elements), 12, 12))
    for i, one in enumerate(elements):
        carried = carried_by(np.array(one.offset_m))
        body = np.array([one.mass_kg] * 3 + list(one.inertia_kg_m2))
        mass[i, 6:, 6:] = carried.T @ (body[:, None] * carried)
    nodes = np.array([[-1, number[one.node]] for one in elements])
    groups = tuple(one.group for one in elements)
    return ElementMatrices(nodes, np.zeros_like(mass), mass, groups)


def _shells(
    elements: Sequence[Shell], number: dict[str, int], coordinates: np.ndarray
) -> ElementMatrices:
    nodes = np.array([[number[node] for node in one.corners] for one in elements])
    places = coordinates[nodes]
    axes = plates.shell_axes(places)
    young = np.array([one.material.young_pa for one in elements])
    poisson = np.array([one.material.poisson for one in elements])
    density = np.array([one.material.density_kg_m3 for one in elements])
    thickness = np.array([one.thickness_m for one in elements])
    stiffness = plates.shell_stiffness(places, axes, (young, poisson), thickness)
    mass = plates.shell_mass(places, axes, density, thickness)
    groups = tuple(one.group for one in elements)
    return ElementMatrices(
        nodes, lines.to_global(stiffness, axes), lines.to_global(mass, axes), groups
    )

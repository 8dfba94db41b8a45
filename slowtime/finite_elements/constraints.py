r"""Elimination of supports, rigid links and multi-point constraints.

Homogeneous linear constraints :math:`A u = 0` leave :math:`u = T q` with the independent
coordinates q, and the matrices become :math:`T^T K T` and :math:`T^T M T`.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from .degrees_of_freedom import DofMap
from .frame import MultiPointConstraint, RigidLink, Support
from .parametric_matrices import ParametricMatrices

Equation = tuple[tuple[int, float], ...]
"""Degrees of freedom and their coefficients; the first is eliminated."""

SINGULAR = 1e-10
"""Pivot over the largest coefficient [1] below which constraints contradict or repeat."""


def support_equations(dofs: DofMap, supports: Sequence[Support]) -> list[Equation]:
    """Equations of supports: each held displacement is zero."""
    held = {dofs.find(one.node, way) for one in supports for way in one.directions}
    return [((position, 1.0),) for position in sorted(held)]


def link_equations(dofs: DofMap, links: Sequence[RigidLink]) -> list[Equation]:
    r"""Equations of rigid links, :math:`u_f = u_l + \theta_l \times r`, equal rotations."""
    found: list[Equation] = []
    number = {name: i for i, name in enumerate(dofs.node_names)}
    for link in links:
        for name in (link.leading, link.following):
            dofs.find(name, "ux")
        arm = dofs.coordinates[number[link.following]] - dofs.coordinates[number[link.leading]]
        lead = [dofs.find(link.leading, way) for way in ("ux", "uy", "uz", "rx", "ry", "rz")]
        follow = [
            dofs.find(link.following, way) for way in ("ux", "uy", "uz", "rx", "ry", "rz")
        ]
        carried = carried_by(arm)
        for row in range(6):
            terms = [(lead[c], -float(carried[row, c])) for c in range(6) if carried[row, c]]
            found.append(((follow[row], 1.0), *terms))
    return found


def carried_by(arm: np.ndarray) -> np.ndarray:
    """Displacement and rotation at the end of a rigid arm, from those at its beginning."""
    x, y, z = (float(part) for part in arm)
    carried = np.eye(6)
    carried[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return carried


def constraint_equations(
    dofs: DofMap, constraints: Sequence[MultiPointConstraint]
) -> list[Equation]:
    """Equations of multi-point constraints."""
    return [
        tuple((dofs.find(node, way), value) for node, way, value in one.terms)
        for one in constraints
    ]


def transformation(size: int, equations: Sequence[Equation]) -> sparse.csr_array:
    """Matrix T with u = T q for the independent coordinates q.

    The first degree of freedom of each equation is eliminated. Raises `ValueError` where two
    eliminate the same one, or depend on each other.
    """
    first = [equation[0][0] for equation in equations]
    if len(set(first)) < len(first):
        twice = next(position for position in first if first.count(position) > 1)
        raise ValueError(
            f"Two constraints eliminate degree of freedom number {twice + 1}. Hold it once, or "
            "begin one of the relations with another degree of freedom."
        )
    keep = np.setdiff1d(np.arange(size), first)
    column = np.full(size, -1)
    column[keep] = np.arange(len(keep))
    unity = sparse.csr_array(
        (np.ones(len(keep)), (keep, column[keep])), shape=(size, len(keep))
    )
    if not equations:
        return unity
    rows = [i for i, equation in enumerate(equations) for _ in equation]
    columns = [term[0] for equation in equations for term in equation]
    values = [term[1] for equation in equations for term in equation]
    whole = sparse.csc_array((values, (rows, columns)), shape=(len(first), size))
    dependent = _solved(sparse.csc_array(whole[:, first]), sparse.csc_array(whole[:, keep]))
    place = sparse.csr_array(
        (np.ones(len(first)), (first, range(len(first)))), shape=(size, len(first))
    )
    return sparse.csr_array(unity + place @ dependent)


def _solved(own: sparse.csc_array, others: sparse.csc_array) -> sparse.csc_array:
    try:
        lu = splu(own)
    except RuntimeError:
        pivots = np.zeros(1)
    else:
        pivots = np.abs(lu.U.diagonal())
    if pivots.min() <= SINGULAR * np.abs(own.data).max():
        raise ValueError(
            "The constraints depend on each other. Remove the one that follows from the others."
        )
    busy = np.flatnonzero(np.diff(others.indptr))
    solution = sparse.coo_array(-lu.solve(np.asarray(others[:, busy].toarray())))
    return sparse.csc_array(
        (solution.data, (solution.row, busy[solution.col])),
        shape=(own.shape[0], others.shape[1]),
    )


def constrain(model: ParametricMatrices, equations: Sequence[Equation]) -> ParametricMatrices:
    """Model on the coordinates that constraints leave free."""
    if not equations:
        return model
    matrix = transformation(model.size, equations)
    expansion = matrix if model.expansion is None else model.expansion @ matrix
    return project_sparse(model, matrix, sparse.csr_array(expansion))


def project_sparse(
    model: ParametricMatrices, matrix: sparse.csr_array, expansion: sparse.csr_array
) -> ParametricMatrices:
    """Model on the coordinates q of u = T q.

    `expansion` leads from q to the degrees of freedom before constraints.
    """

    def turned(part: sparse.csr_array) -> sparse.csr_array:
        return sparse.csr_array(matrix.T @ part @ matrix)

    return dataclasses.replace(
        model,
        stiffness=turned(model.stiffness),
        mass=turned(model.mass),
        damping=None if model.damping is None else turned(model.damping),
        stiffness_parts=tuple(
            None if part is None else turned(part) for part in model.stiffness_parts
        ),
        mass_parts=tuple(None if part is None else turned(part) for part in model.mass_parts),
        expansion=expansion,
    )

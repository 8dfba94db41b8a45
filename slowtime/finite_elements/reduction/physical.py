r"""Reduction whose first coordinates are the motions that sensors, inputs and joints see.

A basis V of modes over the parameters and of static responses to the loads is turned into

.. math:: u = V Q_1 R^{-T} y + V Q_2 z, \qquad (C V)^T = Q_1 R, \qquad Q_1^T Q_2 = 0

so that :math:`C u = y` holds exactly: y are the physical coordinates, z generalized ones.
"""

import numpy as np
import scipy.linalg
from jaxtyping import Float
from scipy import sparse

from slowtime.finite_elements.eigenvalues import lowest_modes
from slowtime.finite_elements.factorization import SymmetricFactor
from slowtime.finite_elements.parametric_matrices import ParametricMatrices

from .basis import parametric_basis
from .candidates import BasisSettings
from .reduced_model import ReducedModel, project

CONDITION = 1e-3
"""Smallest over largest singular value of the rows over the basis [1], above which they serve
as coordinates: the mass matrix then loses six of sixteen digits at most."""


def reduce_to_physical(
    model: ParametricMatrices,
    rows: Float[np.ndarray, "row dof"],
    loads: Float[np.ndarray, "load dof"],
    settings: BasisSettings,
) -> ReducedModel:
    """Reduce a model, keeping some motions as coordinates.

    Parameters
    ----------
    model
        The full model.
    rows
        Motions to keep, over the degrees of freedom before constraints; different ones.
    loads
        Rows of forces whose static response the model has to hold, such as those at joints.
    settings
        Number of modes, range of the parameters, and most coordinates.

    Returns
    -------
    The reduced model; its first coordinates are the motions, in the order of `rows`.

    Raises
    ------
    ValueError
        Where some of the motions depend on each other, or cannot move.
    """
    own = model.rows(rows)
    exact = _static(model, model.rows(loads).T)
    basis = parametric_basis(model, settings, exact=exact if exact.size else None)
    if _conditioned(own @ basis) < CONDITION:
        exact = np.concatenate([exact, _static(model, own.T)], axis=1)
        basis = parametric_basis(model, settings, exact=exact)
    seen = own @ basis
    if _conditioned(seen) < CONDITION:
        raise ValueError(
            f"The {len(rows)} motions to be kept depend on each other, or some of them are "
            "held. Leave out sensors at held nodes and sensors that see the same motion."
        )
    mixture = np.eye(basis.shape[1])
    if len(rows):
        whole, upper = np.linalg.qr(seen.T, mode="complete")
        count = len(rows)
        first = scipy.linalg.solve_triangular(upper[:count], whole[:, :count].T).T
        mixture = np.concatenate([first, whole[:, count:]], axis=1)
    return project(model, basis @ mixture, interface=len(rows))


def _static(
    model: ParametricMatrices, forces: Float[np.ndarray, "own load"]
) -> Float[np.ndarray, "own load"]:
    """Find static responses; of a structure free to move, with a share of its inertia."""
    if not forces.size:
        return np.zeros((model.size, 0))
    factor = SymmetricFactor(model.stiffness)
    if factor.singular:
        found = lowest_modes(model.stiffness, model.mass, min(8, model.size)).eigenvalue
        elastic = found[found > 0.0]
        shift = float(elastic[0]) if elastic.size else 1.0
        factor = SymmetricFactor(sparse.csr_array(model.stiffness + shift * model.mass))
    response = factor.solve(np.asfortranarray(forces))
    weight = np.sqrt(np.maximum(np.sum(response * (model.mass @ response), axis=0), 0.0))
    return np.asarray(response / np.where(weight > 0.0, weight, 1.0))


def _conditioned(seen: Float[np.ndarray, "row coordinate"]) -> float:
    """Smallest over largest singular value, each row at norm 1; 0 where rows are dependent."""
    if not len(seen):
        return 1.0
    norm = np.linalg.norm(seen, axis=1, keepdims=True)
    if len(seen) > seen.shape[1] or not (norm > 0.0).all():
        return 0.0
    values = np.linalg.svd(seen / norm, compute_uv=False)
    return float(values[-1] / values[0])

r"""Craig-Bampton reduction: interface degrees of freedom stay physical coordinates.

.. math:: \begin{pmatrix} u_b \\ u_i \end{pmatrix} =
          \begin{pmatrix} I & 0 \\ \Psi & \Phi \end{pmatrix}
          \begin{pmatrix} u_b \\ q \end{pmatrix}, \qquad \Psi = -K_{ii}^{-1} K_{ib}

with :math:`\Phi` the fixed-interface modes over the range of the parameters, and the
derivatives of :math:`\Psi` by them.

References
----------
.. [1] R. R. Craig, M. C. C. Bampton, "Coupling of substructures for dynamic analyses", AIAA
   Journal 6 (1968).
"""

import dataclasses

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from slowtime.finite_elements.factorization import SymmetricFactor
from slowtime.finite_elements.parametric_matrices import ParametricMatrices

from .basis import parametric_basis
from .candidates import BasisSettings
from .reduced_model import ReducedModel, orthonormal_mixture, project

NEGLIGIBLE = 1e-4
"""Size of a derivative of constraint modes, over the largest [1], below which it is left out;
frequencies feel its square."""


def craig_bampton(
    model: ParametricMatrices,
    interface: Int[np.ndarray, " interface"],
    settings: BasisSettings,
) -> ReducedModel:
    """Reduce a model, keeping some of its coordinates as they are.

    Parameters
    ----------
    model
        The full model.
    interface
        Positions of the coordinates to keep.
    settings
        Of the fixed-interface modes; `coordinates` counts all but the interface.

    Returns
    -------
    The reduced model; its first coordinates are the interface.

    Raises
    ------
    ValueError
        Where holding the interface does not hold the structure.
    """
    inner = np.setdiff1d(np.arange(model.size), interface)
    if (
        len(set(interface.tolist())) < len(interface)
        or len(inner) + len(interface) != model.size
    ):
        raise ValueError(
            f"Interface {interface.tolist()[:10]} was given. Allowed are different positions "
            f"from 0 to {model.size - 1}."
        )
    inside = restrict(model, inner)
    factor = SymmetricFactor(inside.stiffness)
    if factor.singular:
        raise ValueError(
            "With the interface held the rest can still move as a rigid body. Add degrees of "
            "freedom to the interface."
        )
    coupling = model.stiffness[inner][:, interface].toarray()
    constraint = -factor.solve(coupling)
    derivatives = _constraint_derivatives(model, inner, interface, constraint, factor)
    fixed = parametric_basis(inside, settings, exact=derivatives)
    basis = np.zeros((model.size, len(interface) + fixed.shape[1]))
    basis[interface, range(len(interface))] = 1.0
    basis[inner, : len(interface)] = constraint
    basis[inner, len(interface) :] = fixed
    return project(model, basis, interface=len(interface))


def restrict(
    model: ParametricMatrices, positions: Int[np.ndarray, " kept"]
) -> ParametricMatrices:
    """Model with all but some coordinates held.

    Positions are those of the coordinates that stay free.
    """

    def block(part: sparse.csr_array) -> sparse.csr_array:
        return sparse.csr_array(part[positions][:, positions])

    pick = sparse.csr_array(
        (np.ones(len(positions)), (positions, range(len(positions)))),
        shape=(model.size, len(positions)),
    )
    return dataclasses.replace(
        model,
        stiffness=block(model.stiffness),
        mass=block(model.mass),
        damping=None if model.damping is None else block(model.damping),
        stiffness_parts=tuple(
            None if part is None else block(part) for part in model.stiffness_parts
        ),
        mass_parts=tuple(None if part is None else block(part) for part in model.mass_parts),
        expansion=pick if model.expansion is None else sparse.csr_array(model.expansion @ pick),
    )


def _constraint_derivatives(
    model: ParametricMatrices,
    inner: np.ndarray,
    interface: np.ndarray,
    constraint: np.ndarray,
    factor: SymmetricFactor,
) -> Float[np.ndarray, "inner direction"]:
    r"""Find main directions of :math:`-K_{ii}^{-1} (K_{p,ib} + K_{p,ii} \Psi)` over p."""
    whole = np.zeros((model.size, len(interface)))
    whole[interface, range(len(interface))] = 1.0
    whole[inner] = constraint
    found = [
        factor.solve(model.stiffness_family.times(whole, i)[inner])
        for i, part in enumerate(model.stiffness_parts)
        if part is not None
    ]
    columns = np.concatenate([np.zeros((len(inner), 0)), *found], axis=1)
    if not columns.size:
        return columns
    gram = columns.T @ (model.stiffness[inner][:, inner] @ columns)
    values, vectors = np.linalg.eigh(gram)
    kept = values > NEGLIGIBLE**2 * max(values[-1], np.finfo(float).tiny)
    columns = columns @ vectors[:, kept]
    return np.asarray(columns @ orthonormal_mixture(np.diag(values[kept])))

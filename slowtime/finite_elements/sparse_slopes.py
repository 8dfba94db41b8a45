"""Modes of a sparse model with their slopes by the parameters."""

import numpy as np
from jaxtyping import Float
from scipy import sparse

from .definiteness import check_definite
from .eigenvalues import SparseModes, lowest_modes
from .factorization import SymmetricFactor
from .parametric_matrices import ParametricMatrices
from .sensitivities import ModeSlopes, SolvedModel, mode_slopes

BEYOND = 6
"""Modes found beyond those whose slopes are wanted, for the series of the rest to converge."""

TOLERANCE = 1e-10
"""Relative error of eigenvalues [1]; that of shapes is its square root at most, and slopes are
only needed to that."""


def sparse_mode_slopes(
    model: ParametricMatrices,
    theta: Float[np.ndarray, " parameter"],
    rows: Float[np.ndarray, "sensor own"],
    count: int,
    *,
    added_mass: sparse.csr_array | None = None,
) -> tuple[SparseModes, ModeSlopes]:
    """Lowest elastic modes of a sparse model, with slopes by its parameters.

    Rigid motions are not counted, and left out. No parameter acts on the added mass [kg].
    """
    stiffness, mass = model.at(theta)
    if added_mass is not None:
        mass = sparse.csr_array(mass + added_mass)
    factor, shift = SymmetricFactor(stiffness), 0.0
    check_definite(model, theta, factor)
    rigid = 6 if factor.singular else 0
    number = min(count + BEYOND + rigid, model.size)
    found = lowest_modes(
        stiffness, mass, number, check=False, factor=factor, tolerance=TOLERANCE
    )
    elastic = np.flatnonzero(found.eigenvalue > 0.0)
    if factor.singular:
        shift = -float(found.eigenvalue[elastic[0]])
        factor = SymmetricFactor(sparse.csr_array(stiffness - shift * mass))
    solved = SolvedModel(
        eigenvalue=found.eigenvalue,
        shapes=found.shapes,
        stiffness_family=model.stiffness_family,
        mass_family=model.mass_family,
        weigh=mass.__matmul__,
        solve=factor.solve,
        shift=shift,
    )
    wanted = elastic[:count]
    modes = SparseModes(
        eigenvalue=found.eigenvalue[wanted],
        shapes=found.shapes[:, wanted],
        residual=found.residual[wanted],
        counted=False,
    )
    return modes, mode_slopes(solved, rows, wanted)

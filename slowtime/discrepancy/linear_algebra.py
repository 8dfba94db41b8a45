"""Solution of least-squares equations whose matrix rounding may leave indefinite."""

import numpy as np
import scipy.linalg
from jaxtyping import Float

MIN_EIGENVALUE = 1e-9
"""[1] Of a matrix with a diagonal of ones, to which smaller ones are raised. Source: well above
double precision, well below what a prior adds."""


def solve_semidefinite(
    matrix: Float[np.ndarray, "own own"], right: Float[np.ndarray, " own"]
) -> Float[np.ndarray, " own"]:
    """Solve for a symmetric matrix that is positive definite but for rounding."""
    if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
        raise np.linalg.LinAlgError("normal equations that are not finite")
    try:
        factor = scipy.linalg.cho_factor(matrix)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(matrix)
        kept = np.maximum(values, MIN_EIGENVALUE)
        return np.asarray(vectors @ ((vectors.T @ right) / kept))
    return np.asarray(scipy.linalg.cho_solve(factor, right))

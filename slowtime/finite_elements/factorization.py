"""Sparse factorisation of symmetric matrices, with their inertia (Sylvester's law)."""

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

Columns = Float[np.ndarray, "own ..."]
"""One vector, or one a column."""

MASSLESS = 1e-11
"""Pivot over the diagonal entry [1] below which rounding cannot tell it from zero: some
thousand times the rounding of double precision, for the sums of elimination."""


class SymmetricFactor:
    """Factors of a sparse symmetric matrix, without interchanges where pivots allow it."""

    def __init__(self, matrix: sparse.csr_array) -> None:
        self._diagonal = np.abs(matrix.diagonal())
        columns = sparse.csc_array(matrix)
        columns.indices = columns.indices.astype(np.int32)
        columns.indptr = columns.indptr.astype(np.int32)
        self.singular = False
        try:
            self._lu: SuperLU | None = splu(
                columns,
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError:
            self._lu, self.singular = None, True
            return
        pivots = self._lu.U.diagonal()
        self.symmetric = bool((self._lu.perm_r == self._lu.perm_c).all())
        self.negative = int(np.sum(pivots < 0.0))
        place = np.empty(len(pivots), dtype=int)
        place[self._lu.perm_c] = np.arange(len(pivots))
        own = self._diagonal[place]
        self.singular = bool((np.abs(pivots) <= MASSLESS * np.where(own > 0, own, 1.0)).any())

    def solve(self, right: Columns) -> Columns:
        """Solve for one or several right-hand sides.

        Raises `ValueError` where the matrix is singular.
        """
        if self._lu is None:
            raise ValueError(
                "A sparse matrix is singular. Hold the structure by supports, or give a "
                "negative shift for a structure that is free to move."
            )
        return np.asarray(self._lu.solve(right))


def eigenvalues_below(
    stiffness: sparse.csr_array, mass: sparse.csr_array, bound: float
) -> int | None:
    r"""Count the eigenvalues of :math:`K x = \lambda M x` below a bound (Sturm count).

    The count is the number of negative pivots of :math:`K - \sigma M`.

    It is None where the factorisation had to interchange rows, as with a bound too near to an
    eigenvalue. Bounds are in rad^2/s^2.

    References
    ----------
    .. [1] B. N. Parlett, "The Symmetric Eigenvalue Problem", SIAM (1998), section 3.3.
    """
    factor = SymmetricFactor(sparse.csr_array(stiffness - bound * mass))
    if factor.singular or not factor.symmetric:
        return None
    return factor.negative

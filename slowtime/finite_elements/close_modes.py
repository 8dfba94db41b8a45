"""Modes whose frequencies are close, compared as subspaces."""

import numpy as np
import scipy.linalg
from jaxtyping import Float
from scipy import sparse

CLOSE = 0.01
"""Relative distance of two frequencies [1] up to which their modes are one subspace: shapes of
modes so close rotate among each other under changes of stiffness of a few per cent."""


def close_groups(frequency_hz: Float[np.ndarray, " mode"]) -> list[list[int]]:
    """Gather neighbouring modes, each within `CLOSE` of the one before.

    Examples
    --------
    >>> close_groups(np.array([1.0, 1.005, 2.0]))
    [[0, 1], [2]]
    """
    groups: list[list[int]] = []
    values = frequency_hz.tolist()
    for j, frequency in enumerate(values):
        if groups and frequency - values[groups[-1][-1]] <= CLOSE * frequency:
            groups[-1].append(j)
        else:
            groups.append([j])
    return groups


def mass_weighted_agreement(
    found: Float[np.ndarray, "own found"],
    reference: Float[np.ndarray, "own reference"],
    mass: sparse.csr_array,
) -> float:
    r"""Smallest squared cosine between a subspace of modes and one that should hold it.

    .. math:: \min_v \frac{\|P v\|_M^2}{\|v\|_M^2}, \qquad v \in \operatorname{span}(found)

    with P the M-orthogonal projection onto the reference. For one mode each this is the MAC
    weighted by mass.
    """
    one, other = _orthonormal(found, mass), _orthonormal(reference, mass)
    cosines = scipy.linalg.svdvals(one.T @ (mass @ other))
    return float(min(cosines[: found.shape[1]].min() ** 2, 1.0))


def _orthonormal(columns: np.ndarray, mass: sparse.csr_array) -> np.ndarray:
    lower = scipy.linalg.cholesky(columns.T @ (mass @ columns), lower=True)
    return np.asarray(scipy.linalg.solve_triangular(lower, columns.T, lower=True).T)

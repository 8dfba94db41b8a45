r"""Likelihood of the spectral matrices of a band, and the inverse density behind it.

Matrices are a few rows large and there are a hundred of them, so that each step of a Cholesky
decomposition is taken for all groups of ordinates at once.
"""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

from .model import BandData, BandModel


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class LikelihoodEvaluation:
    """What a model predicts of the data, and how likely that makes them.

    The precision is None, and the likelihood minus infinity, where the density is not positive
    definite.
    """

    gain: Complex[np.ndarray, "mode group"]
    bent: Complex[np.ndarray, "mode group"]
    density: Complex[np.ndarray, "group direction direction"]
    precision: Complex[np.ndarray, "group direction direction"] | None
    log_likelihood: float


def evaluate(
    data: BandData, model: BandModel, known: LikelihoodEvaluation | None = None
) -> LikelihoodEvaluation:
    """Predict the data, and say how likely they are.

    Poles of the model `known` need not be evaluated again.
    """
    if known is None:
        gain, bent = model.gain(data.omega, data.width)
    else:
        gain, bent = known.gain, known.bent
    density = model.density_of_gain(data.omega, gain)
    precision, logarithm = inverse_density(density)
    return LikelihoodEvaluation(
        gain, bent, density, precision, _log_likelihood(data, precision, logarithm)
    )


def inverse_density(
    density: Complex[np.ndarray, "group direction direction"],
) -> tuple[np.ndarray | None, np.ndarray]:
    """Inverses of positive definite matrices, and logarithms of their determinants.

    Only upper triangles are read; None if any matrix is not positive definite.
    """
    s = np.ascontiguousarray(density.transpose(1, 2, 0))
    root = np.zeros_like(s)
    pivots = np.empty(s.shape[1:])
    for i in range(len(s)):
        pivots[i] = s[i, i].real
        if i:
            # Row i of the Cholesky factor is what the rows above leave of column i.
            row = (root[:i, :i] * s[:i, i]).sum(axis=1)
            pivots[i] -= (row.real**2 + row.imag**2).sum(axis=0)
        if not pivots[i].min() > 0:
            return None, np.full(s.shape[2], np.inf)
        root[i, i] = 1.0 / np.sqrt(pivots[i])
        if i:
            root[i, :i] = (row.conj()[:, None] * root[:i, :i]).sum(axis=0) * -root[i, i]
    by_group = np.ascontiguousarray(root.transpose(2, 0, 1))
    inverse = by_group.conj().transpose(0, 2, 1) @ by_group
    return inverse, np.log(pivots).sum(axis=0)


def band_log_likelihood(
    data: BandData, density: Complex[np.ndarray, "group direction direction"]
) -> float:
    """Whittle log-likelihood; minus infinity if the density is not positive definite."""
    return _log_likelihood(data, *inverse_density(density))


def _log_likelihood(
    data: BandData, precision: np.ndarray | None, logarithm: Float[np.ndarray, " group"]
) -> float:
    if precision is None:
        return -np.inf
    # Trace of a product of Hermitian matrices.
    trace = np.einsum("gij,gij->g", precision, data.density.conj()).real
    return float(-np.dot(data.number, logarithm + trace))

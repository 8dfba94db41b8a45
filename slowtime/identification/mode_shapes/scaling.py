r"""Least-squares scaling of partial mode shapes into one shape.

Least squares of :math:`\hat\phi_{sj} = c_s \psi_j + \epsilon_{sj}`, each component weighted by
its inverse variance, 0 where a part does not have it.
"""

import numpy as np
from jaxtyping import Bool, Complex, Float

ROUNDS = 200
"""Rounds of alternating least squares, at most."""

SETTLED = 1e-10
"""Relative change of the shape at which the rounds stop [1]."""


def scale_shapes(
    seen: Complex[np.ndarray, "setup channel"], weight: Float[np.ndarray, "setup channel"]
) -> tuple[Complex[np.ndarray, " setup"], Complex[np.ndarray, " channel"]]:
    """Scale partial shapes into one by alternating least squares.

    Both are 0 where a component was not measured; the factor of the first set-up is 1.
    """
    factors = np.ones(len(seen), dtype=complex)
    for row in range(1, len(seen)):
        both = weight[:row] * weight[row]
        factors[row] = _ratio(seen[:row] / factors[:row, None], seen[row], both)
    shape = np.zeros(seen.shape[1], dtype=complex)
    for _ in range(ROUNDS):
        before = shape
        power = np.abs(factors) ** 2 @ weight
        shape = (factors.conj() @ (weight * seen)) / np.where(power > 0, power, 1.0)
        power = weight @ np.abs(shape) ** 2
        factors = ((weight * seen) @ shape.conj()) / np.where(power > 0, power, 1.0)
        factors = factors / factors[0]
        if np.linalg.norm(shape - before) < SETTLED * np.linalg.norm(shape):
            break
    return factors, shape


def _ratio(known: np.ndarray, seen: np.ndarray, weight: np.ndarray) -> complex:
    """Factor of a part against those before it, by what both heard."""
    power = np.sum(weight * np.abs(known) ** 2)
    return complex(np.sum(weight * known.conj() * seen) / power) if power > 0 else 1.0


def shape_covariance(
    factors: np.ndarray, shape: np.ndarray, weight: np.ndarray, heard: Bool[np.ndarray, " c"]
) -> Complex[np.ndarray, "channel channel"]:
    """Covariance of the merged shape, the factor of the first set-up fixed at 1."""
    cross = (weight * shape.conj()).T[:, 1:] * factors[1:]
    of_shape = np.diag(np.where(heard, np.abs(factors) ** 2 @ weight, 1.0))
    of_factors = np.diag((weight @ np.abs(shape) ** 2)[1:])
    normal = np.block([[of_shape + 0j, cross.conj()], [cross.T, of_factors]])
    count = len(shape)
    found = np.linalg.pinv(normal, hermitian=True)[:count, :count]
    return np.asarray(np.where(np.outer(heard, heard), found, 0.0))


def normalise_with_errors(
    shape: np.ndarray, covariance: np.ndarray
) -> tuple[Complex[np.ndarray, " channel"], Float[np.ndarray, " channel"]]:
    """Unit-norm shape with real, positive largest component, and its errors."""
    norm, largest = np.linalg.norm(shape), int(np.argmax(np.abs(shape)))
    turn = np.conj(shape[largest]) / np.abs(shape[largest])
    unit = shape * turn / norm
    across = np.eye(len(unit)) - np.outer(unit, unit.conj())
    spread = across @ covariance @ across.conj().T / norm**2
    top = unit[largest].real
    variance = (
        np.diag(spread).real
        + np.abs(unit) ** 2 * spread[largest, largest].real / (2 * top**2)
        - (spread[:, largest] * unit.conj()).real / top
    )
    return unit, np.sqrt(np.maximum(variance, 0.0))

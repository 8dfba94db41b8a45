r"""Poles of all model orders from one QR decomposition, and the errors of those asked for.

The observability matrix of order n is the first n columns of that of the highest order. With
:math:`\Gamma_\uparrow = Q R` for the upper block rows of all columns, the system matrix of each
order is :math:`R_n^{-1} (Q^H \Gamma_\downarrow)_n`, leading blocks of n rows and columns.
The rows that the errors of a pole ask for come from products with Q that all orders share.

References
----------
.. [1] M. Döhler, L. Mevel, "Fast multi-order computation of system matrices in subspace-based
   system identification", Control Engineering Practice 20 (2012).
.. [2] M. Döhler, L. Mevel, "Efficient multi-order uncertainty computation for stochastic
   subspace identification", MSSP 38 (2013).
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy.linalg

from .model_orders import PolesOfOrder, WeightedSubspace, poles_of_order
from .poles import PoleLimits

RANK = 1e-12
"""Least diagonal element of R, relative to the largest [1]; below, columns are dependent to
rounding, and each order takes a pseudo-inverse of its own."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Shared:
    """What all orders share.

    Parameters
    ----------
    inverse
        Of R; its leading blocks are the inverses of those of R.
    shifted
        :math:`Q^H` times the lower block rows.
    lower, upper
        :math:`Q^H` times the lower and upper block rows of what takes the weighting back.
    errors
        Draws of the weighted matrix in the subspace, ["draw * row", "column"].
    """

    inverse: np.ndarray
    shifted: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    errors: np.ndarray


def poles_of_orders(
    subspace: WeightedSubspace,
    orders: Sequence[int],
    centre_hz: float,
    errors_within: PoleLimits | None = None,
) -> list[PolesOfOrder]:
    """Poles of positive frequency of several orders, with what the draws move them by.

    It is what `poles_of_order` gives of each order without errors of the shapes, to rounding.
    Errors are computed for the poles within the limits; those of others are nan.
    """
    channels = subspace.channels
    q, triangle = np.linalg.qr(subspace.gamma[:-channels])
    diagonal = np.abs(np.diag(triangle))
    if not diagonal.min() > RANK * diagonal.max():
        return [poles_of_order(subspace, n, centre_hz, False) for n in orders]
    turned = q.conj().T
    shared = _Shared(
        inverse=np.asarray(scipy.linalg.solve_triangular(triangle, np.eye(len(triangle)))),
        shifted=turned @ subspace.gamma[channels:],
        lower=turned @ subspace.unweighted[channels:],
        upper=turned @ subspace.unweighted[:-channels],
        errors=subspace.errors.reshape(-1, subspace.errors.shape[2]),
    )
    return [_of_order(subspace, shared, n, centre_hz, errors_within) for n in orders]


def _of_order(
    subspace: WeightedSubspace,
    shared: _Shared,
    n: int,
    centre_hz: float,
    errors_within: PoleLimits | None,
) -> PolesOfOrder:
    inverse = shared.inverse[:n, :n]
    value, right = np.linalg.eig(inverse @ shared.shifted[:n, :n])
    observed = np.linalg.inv(right) @ inverse
    keep = value != 0
    pole = np.zeros_like(value, dtype=complex)
    pole[keep] = np.log(value[keep].astype(complex)) * subspace.rate_hz
    pole += 2j * np.pi * centre_hz
    at = np.flatnonzero(keep & (pole.imag > 0))
    value, pole, right, observed = value[at], pole[at], right[:, at], observed[at]
    shape = subspace.gamma[: subspace.channels, :n] @ right
    draws = np.full((len(subspace.errors), len(at)), np.nan, dtype=complex)
    asked = np.arange(len(at)) if errors_within is None else errors_within.inside(pole)
    if len(asked):
        own, turn = observed[asked], value[asked]
        # Of a pole these are orthogonal to the subspace as they are: no projection is needed.
        rows = own @ shared.lower[:n] - (turn[:, None] * own) @ shared.upper[:n]
        moved = shared.errors[:, :n] @ right[:, asked]
        moved = moved.reshape(len(draws), rows.shape[1], -1)
        draws[:, asked] = np.einsum("jr,krj->kj", rows, moved) * (subspace.rate_hz / turn)
    return n, pole, shape / np.linalg.norm(shape, axis=0), draws, None

r"""Least squares over nested sets of terms, with corrected leave-one-out errors.

One QR factorisation of the columns in their order serves every set of leading columns: the
leverages are partial sums of the squares of Q, the residuals lose one projection at a time.
"""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

INDEPENDENT = 1e-9
"""Least share of a column that must lie outside those before it."""


@dataclasses.dataclass(frozen=True, slots=True)
class Expansion:
    """Coefficients of the terms kept, and how well they foretell points left out."""

    terms: Int[np.ndarray, " kept"]
    coefficients: Float[np.ndarray, " kept"]
    triangle: Float[np.ndarray, "kept kept"]
    """R of the QR factorisation of the columns kept: their covariance up to a factor."""

    loo: float
    """Corrected leave-one-out error, a mean square."""

    condition: float


def nested(
    design: Float[np.ndarray, "sample term"],
    outputs: Float[np.ndarray, " sample"],
    order: Int[np.ndarray, " ranked"],
) -> Expansion:
    r"""Fit the leading columns of `order` whose number predicts best.

    The mean of :math:`((y_i - \hat y_i) / (1 - h_i))^2` is corrected for small samples by
    :math:`\frac{n}{n - p} (1 + \mathrm{tr}(\Phi^T \Phi)^{-1})` (Chapelle, Vapnik and
    Bengio 2002; Blatman and Sudret 2011).

    Parameters
    ----------
    design
        Value of each term at each point.
    outputs
        Output at each point.
    order
        Columns of `design`, the most important first.

    Returns
    -------
    The expansion with the least corrected leave-one-out error.

    References
    ----------
    .. [1] O. Chapelle, V. Vapnik and Y. Bengio, "Model selection for small sample regression",
       Machine Learning 48 (2002) 9-23.
    .. [2] G. Blatman and B. Sudret, "Adaptive sparse polynomial chaos expansion based on least
       angle regression", J. Comput. Phys. 230 (2011) 2345-2367.
    """
    count = len(outputs)
    order = _independent(design, order)[: count - 1]
    q, r = np.linalg.qr(design[:, order])
    leverage = np.cumsum(q**2, axis=1)
    residual = outputs[:, None] - np.cumsum(q * (q.T @ outputs), axis=1)
    # A point that only its own term explains cannot be foretold: left out, nothing is known.
    left_out = np.where(leverage < 1.0 - 1e-9, residual / np.maximum(1.0 - leverage, 1e-9), 0.0)
    loo = np.mean(left_out**2, axis=0)
    loo[(leverage >= 1.0 - 1e-9).any(axis=0)] = np.inf
    spread = np.cumsum(np.sum(_inverse(r) ** 2, axis=0))
    size = np.arange(1, len(order) + 1)
    corrected = loo * count / (count - size) * (1.0 + spread)
    kept = int(np.argmin(corrected)) + 1
    triangle = r[:kept, :kept]
    values = np.linalg.svd(triangle, compute_uv=False)
    return Expansion(
        terms=order[:kept],
        coefficients=np.linalg.solve(triangle, q[:, :kept].T @ outputs),
        triangle=triangle,
        loo=float(corrected[kept - 1]),
        condition=float(values[0] / values[-1]),
    )


def all_of(
    design: Float[np.ndarray, "sample term"], outputs: Float[np.ndarray, " sample"]
) -> Expansion:
    """Fit every column by ordinary least squares, with the corrected leave-one-out error.

    Parameters
    ----------
    design
        Value of each term at each point.
    outputs
        Output at each point.

    Returns
    -------
    The expansion; its error is infinite where the columns are dependent or too many.
    """
    count, size = design.shape
    q, r = np.linalg.qr(design)
    values = np.linalg.svd(r, compute_uv=False)
    if size >= count or values[-1] < INDEPENDENT * values[0]:
        return Expansion(np.arange(size), np.zeros(size), np.eye(size), np.inf, np.inf)
    leverage = np.minimum(np.sum(q**2, axis=1), 1.0 - 1e-12)
    residual = outputs - q @ (q.T @ outputs)
    loo = float(np.mean((residual / (1.0 - leverage)) ** 2))
    factor = count / (count - size) * (1.0 + float(np.sum(_inverse(r) ** 2)))
    return Expansion(
        terms=np.arange(size),
        coefficients=np.linalg.solve(r, q.T @ outputs),
        triangle=r,
        loo=loo * factor,
        condition=float(values[0] / values[-1]),
    )


def _inverse(triangle: np.ndarray) -> np.ndarray:
    inverse: np.ndarray = np.linalg.solve(triangle, np.eye(len(triangle)))
    return inverse


def _independent(design: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Leave out columns that those before them already span."""
    kept: list[int] = []
    basis = np.empty((len(design), 0))
    for column in order:
        if basis.shape[1] == len(design):
            break
        whole = design[:, column]
        rest = whole - basis @ (basis.T @ whole)
        rest -= basis @ (basis.T @ rest)
        size = float(np.linalg.norm(rest))
        if size > INDEPENDENT * float(np.linalg.norm(whole)):
            kept.append(int(column))
            basis = np.column_stack([basis, rest / size])
    return np.array(kept, dtype=int)

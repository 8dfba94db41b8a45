r"""Slopes of eigenvalues and of mode shapes at sensors by the parameters.

.. math:: \frac{\partial \lambda_j}{\partial \theta_p} &= x_j^T (K_p - \lambda_j M_p) x_j \\
          \frac{\partial x_j}{\partial \theta_p} &= -\Big(\sum_{r \ne j}
          \frac{x_r x_r^T}{\lambda_r - \lambda_j}\Big) (K_p - \lambda_j M_p) x_j
          - \tfrac{1}{2} (x_j^T M_p x_j) x_j

The sum over modes r is taken as it is over the modes that were found. The rest is applied to
the rows of the sensors (adjoint method), where it is the series

.. math:: \sum_{r > n} \frac{x_r x_r^T}{\lambda_r - \lambda_j} = \sum_{k \ge 0}
          (\lambda_j - \sigma)^k \, D [(K - \sigma M)^{-1} M]^k (K - \sigma M)^{-1}

with D the removal of the n modes found. One factorisation serves all modes and parameters.

References
----------
.. [1] R. L. Fox, M. P. Kapoor, "Rates of change of eigenvalues and eigenvectors", AIAA Journal
   6 (1968).
.. [2] O. Zhang, A. Zerva, "Accelerated iterative procedure for calculating eigenvector
   derivatives", AIAA Journal 35 (1997).
"""

import dataclasses
from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

REPEATED = 1e-9
"""Relative distance of two eigenvalues [1] whose vectors may turn freely: their mixture is left
out, as it is for repeated ones in which no direction is defined."""

ENOUGH = 1e-6
"""Relative size of the terms of the series [1] at which it ends: far below what measured shapes
tell."""

MOST_TERMS = 12
"""Terms of the series, at most."""


@runtime_checkable
class Family(Protocol):
    """Parts of a matrix by the parameters."""

    @property
    def acts(self) -> bool:
        """Whether any parameter acts on the matrix."""

    def project(
        self, left: Float[np.ndarray, "own left"], right: Float[np.ndarray, "own right"]
    ) -> Float[np.ndarray, "parameter left right"]:
        r"""Compute :math:`L^T K_i R` of every part."""

    def contract(
        self,
        left: Float[np.ndarray, "own left vector"],
        right: Float[np.ndarray, "own vector"],
    ) -> Float[np.ndarray, "parameter left vector"]:
        r"""Compute :math:`L_j^T K_i r_j` of every part."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class SolvedModel:
    r"""A model at certain parameters, solved for its lowest modes.

    Parameters
    ----------
    eigenvalue, shapes
        Modes found, ascending, mass-normalised; more than those whose slopes are wanted.
    weigh
        Product of the mass matrix with columns.
    solve
        Solution of :math:`(K - \sigma M) u = f` for columns f.
    shift
        :math:`\sigma` [rad^2/s^2], below all eigenvalues.
    """

    eigenvalue: Float[np.ndarray, " found"]
    shapes: Float[np.ndarray, "own found"]
    stiffness_family: Family
    mass_family: Family
    weigh: Callable[[np.ndarray], np.ndarray]
    solve: Callable[[np.ndarray], np.ndarray]
    shift: float = 0.0


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ModeSlopes:
    """Slopes by the parameters.

    `sensed` are the slopes of the mass-normalised shapes at the sensors.
    """

    eigenvalue: Float[np.ndarray, "mode parameter"]
    sensed: Float[np.ndarray, "sensor mode parameter"]


def mode_slopes(
    solved: SolvedModel, rows: Float[np.ndarray, "sensor own"], wanted: np.ndarray
) -> ModeSlopes:
    """Slopes of some modes by all parameters."""
    values, shapes = solved.eigenvalue, solved.shapes
    own, right = values[wanted], shapes[:, wanted]
    pulled = solved.stiffness_family.project(shapes, right)
    moved = None
    if solved.mass_family.acts:
        moved = solved.mass_family.project(shapes, right)
        pulled = pulled - own * moved
    picked = np.arange(len(wanted))
    gap = own - values[:, None]
    far = np.abs(gap) > REPEATED * np.abs(values).max()
    mixing = pulled * np.where(far, 1.0 / np.where(far, gap, 1.0), 0.0)
    mixing[:, wanted, picked] = 0.0 if moved is None else -0.5 * moved[:, wanted, picked]
    # One product of matrices: the parameters and modes side by side.
    flat = (rows @ shapes) @ np.moveaxis(mixing, 1, 0).reshape(len(values), -1)
    sensed = flat.reshape(len(rows), len(mixing), len(wanted)).transpose(0, 2, 1)
    rest = _remainder(solved, rows, own)
    if rest is not None:
        tail = solved.stiffness_family.contract(rest, right)
        if moved is not None:
            tail = tail - own * solved.mass_family.contract(rest, right)
        sensed = sensed - tail.transpose(1, 2, 0)
    return ModeSlopes(np.asarray(pulled[:, wanted, picked].T), np.asarray(sensed))


def _remainder(
    solved: SolvedModel, rows: np.ndarray, own: Float[np.ndarray, " mode"]
) -> Float[np.ndarray, "own sensor mode"] | None:
    """Sum of the series for the modes that were not found; None if there are no others."""
    size, count = solved.shapes.shape
    if count == size or not len(rows) or not len(own):
        return None
    away = own - solved.shift
    ratio = min(max(float(away.max() / (solved.eigenvalue[-1] - solved.shift)), 1e-3), 0.99)
    terms = min(int(np.ceil(np.log(ENOUGH) / np.log(ratio))), MOST_TERMS)
    right, power, weighed = rows.T, np.ones(len(own)), solved.weigh(solved.shapes)
    total = np.zeros((size, len(rows), len(own)))
    for _ in range(terms):
        right = solved.solve(np.asfortranarray(right))
        right = right - solved.shapes @ (weighed.T @ right)
        total += right[:, :, None] * power
        right, power = solved.weigh(right), power * away
    return total

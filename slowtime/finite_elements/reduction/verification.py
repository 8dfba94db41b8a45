r"""Error of a reduced model: by residuals, and against full solutions.

With :math:`r = K x - \lambda M x` the residual of a reduced mode in the full model, and all
modes that are missing from the subspace at or above :math:`\lambda_c`,

.. math:: \tilde\lambda - \lambda \approx r^T K^{-1} r \; \frac{\lambda_c}{\lambda_c -
          \tilde\lambda}

at most, as each missing component contributes :math:`(\lambda_k - \lambda)^2 / \lambda_k` to
the left and :math:`\lambda_k - \lambda` to the error.
"""

import dataclasses
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from slowtime.finite_elements.close_modes import close_groups, mass_weighted_agreement
from slowtime.finite_elements.definiteness import check_definite
from slowtime.finite_elements.eigenvalues import SparseModes, lowest_modes
from slowtime.finite_elements.factorization import SymmetricFactor
from slowtime.finite_elements.parametric_matrices import ParametricMatrices

from .adaptive_model import AdaptiveModel
from .reduced_model import ReducedModel, ReducedModes, ReductionError

Reduced = TypeVar("Reduced", ReducedModel, AdaptiveModel)

CUT = 2.0
"""Eigenvalue of the lowest missing motion over that of the highest mode compared [1], supposed
by the estimate: the basis holds modes beyond those compared."""


def verify(
    model: ParametricMatrices,
    reduced: Reduced,
    *,
    modes: int,
    span: float = 0.3,
    trials: int = 2,
    seed: int = 1,
) -> Reduced:
    """Compare a reduced model with full solutions at random parameters.

    Parameters
    ----------
    model, reduced
        The full model and its reduction.
    modes
        How many lowest modes.
    span
        Largest absolute value of the parameters [1].
    trials
        How many random parameters; each costs a full solution.
    seed
        Of the random parameters; another one than that of the basis.

    Returns
    -------
    The reduced model with its `error`.

    Raises
    ------
    IndefiniteStiffnessError
        Where the stiffness has negative eigenvalues at one of the parameters.
    """
    random = np.random.default_rng(seed)
    frequency, agreement, estimated = 0.0, 1.0, 0.0
    for _ in range(trials):
        theta = random.uniform(-span, span, len(model.names))
        stiffness, mass = model.at(theta)
        factor = SymmetricFactor(stiffness)
        check_definite(model, theta, factor)
        found = reduced.modes(theta, modes)
        full = lowest_modes(
            stiffness, mass, min(modes + 4, model.size), check=False, factor=factor
        )
        off, alike = compare_modes(model, reduced, found, full, theta)
        frequency, agreement = max(frequency, off), min(agreement, alike)
        if not factor.singular:
            guess = residual_error(model, reduced, found, theta, factor)
            estimated = max(estimated, float(guess.max()))
    error = ReductionError(
        modes=modes,
        span=span,
        trials=trials,
        estimated=estimated,
        frequency=frequency,
        agreement=agreement,
    )
    return dataclasses.replace(reduced, error=error)


def compare_modes(
    model: ParametricMatrices,
    reduced: ReducedModel | AdaptiveModel,
    found: ReducedModes,
    full: SparseModes,
    theta: Float[np.ndarray, " parameter"],
) -> tuple[float, float]:
    """Largest relative error of the frequencies, and smallest agreement of the shapes.

    Modes within 1 % of each other count as one subspace; a group at the upper end is compared
    with all modes of the full model in it, which may be more.
    """
    count = len(found.eigenvalue)
    elastic = full.eigenvalue[:count] > 0.0
    own, true = found.frequency_hz[elastic], full.frequency_hz[:count][elastic]
    error = float(np.abs(own / true - 1.0).max(initial=0.0))
    mass = model.mass_family.at(theta)
    shapes = reduced.basis @ found.shapes
    alike = [
        mass_weighted_agreement(shapes[:, inside], full.shapes[:, group], mass)
        for group in close_groups(full.frequency_hz)
        if (inside := [j for j in group if j < count])
    ]
    return error, min(alike)


def residual_error(
    model: ParametricMatrices,
    reduced: ReducedModel | AdaptiveModel,
    found: ReducedModes,
    theta: Float[np.ndarray, " parameter"],
    factor: SymmetricFactor,
) -> Float[np.ndarray, " mode"]:
    """Estimate of the relative errors of the frequencies from residuals.

    Rigid motions have an error of 0. Factors are those of the full stiffness at the same
    parameters; those at zero parameters give the estimate within a factor of 1 / (1 - span).
    """
    stiffness, mass = model.at(theta)
    shapes = reduced.basis @ found.shapes
    residual = stiffness @ shapes - (mass @ shapes) * found.eigenvalue
    energy = np.sum(residual * factor.solve(residual), axis=0)
    cut = CUT * found.eigenvalue[-1]
    elastic = found.eigenvalue > 0.0
    value = np.where(elastic, found.eigenvalue, 1.0)
    return np.where(elastic, energy / value * cut / (cut - value) / 2.0, 0.0)

r"""A fixed basis that holds the lowest modes over a range of the parameters.

In the space of the candidates the modes at random parameters are cheap. A proper orthogonal
decomposition of them gives the fewest coordinates whose error in the eigenvalues,
:math:`\|x_j - P x_j\|_A^2 / \|x_j\|_A^2`, stays below the tolerance.
"""

import numpy as np
import scipy.linalg
from jaxtyping import Float

from slowtime.finite_elements.parametric_matrices import ParametricMatrices

from .candidates import BasisSettings, ReductionCandidates, candidates_of
from .reduced_model import orthonormal_mixture


def parametric_basis(
    model: ParametricMatrices,
    settings: BasisSettings,
    *,
    exact: Float[np.ndarray, "own exact"] | None = None,
) -> Float[np.ndarray, "own coordinate"]:
    """Basis of the lowest modes over the parameters, orthonormal in the mass.

    Parameters
    ----------
    model
        The full model.
    settings
        What it has to hold.
    exact
        Further vectors that the basis has to hold exactly, such as static responses to loads.

    Returns
    -------
    The basis. The modes at zero parameters are exact.
    """
    space = candidates_of(model, settings, exact)
    fixed = space.nominal.shapes[:, : settings.modes]
    if exact is not None:
        fixed = np.concatenate([fixed, exact], axis=1)
    if model.names:
        fixed = np.concatenate([fixed, _selected(space, fixed, settings)], axis=1)
    return np.asarray(fixed @ orthonormal_mixture(fixed.T @ (model.mass @ fixed)))


def _selected(
    space: ReductionCandidates, fixed: np.ndarray, settings: BasisSettings
) -> Float[np.ndarray, "own direction"]:
    """Fewest directions beside the fixed ones that hold the modes of the training set."""
    random = np.random.default_rng(settings.seed)
    inside = np.linalg.qr(space.inside(fixed))[0]
    snapshots = []
    for _ in range(settings.training):
        theta = random.uniform(-settings.span, settings.span, len(space.stiffness_parts))
        _, small = scipy.linalg.eigh(
            space.stiffness + np.tensordot(theta, space.stiffness_parts, 1),
            space.mass + np.tensordot(theta, space.mass_parts, 1),
            subset_by_index=(0, min(settings.modes, len(space.mass)) - 1),
        )
        # Candidates are orthonormal in A, so the norm of a column is that in A.
        snapshots.append(small / np.linalg.norm(small, axis=0))
    left = np.concatenate(snapshots, axis=1)
    left = left - inside @ (inside.T @ left)
    directions, _, _ = np.linalg.svd(left, full_matrices=False)
    # Frequencies err by half of the relative error of eigenvalues.
    captured = np.cumsum((directions.T @ left) ** 2, axis=0)
    missing = np.maximum(np.sum(left**2, axis=0) - captured, 0.0).max(axis=1) / 2.0
    enough = np.flatnonzero(missing <= settings.tolerance)
    room = max(settings.coordinates - fixed.shape[1], 0)
    count = min(int(enough[0]) + 1 if enough.size else len(missing), room)
    return np.asarray(space.vectors @ directions[:, :count])

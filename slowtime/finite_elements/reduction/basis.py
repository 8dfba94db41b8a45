r"""A basis that holds the lowest modes over a range of the parameters.

1. *Candidates*: the nominal modes :math:`x_j`, and for each parameter
   :math:`A^{-1} (K_i - \lambda_j M_i) x_j`, the response to the residual that it causes, which
   spans the first derivatives of the modes; then the same once more at random parameters, for
   the second derivatives. Here :math:`A = K_0 + s M_0` is factorised once.
2. *Training*: in the space of the candidates the modes at random parameters are cheap.
   A proper orthogonal decomposition of them, in the norm of A, gives the fewest coordinates
   whose error in the eigenvalues,
   :math:`\|x_j - P x_j\|_A^2 / (\lambda_j + s)`, stays below the tolerance.

References
----------
.. [1] A. Quarteroni, A. Manzoni, F. Negri, "Reduced Basis Methods for Partial Differential
   Equations", Springer (2016), chapters 6 and 7.
.. [2] E. Balmès, "Parametric families of reduced finite element models. Theory and
   applications", Mechanical Systems and Signal Processing 10 (1996).
"""

import dataclasses

import numpy as np
import scipy.linalg
from jaxtyping import Float
from scipy import sparse

from slowtime.finite_elements.eigenvalues import SparseModes, lowest_modes
from slowtime.finite_elements.factorization import SymmetricFactor
from slowtime.finite_elements.parametric_matrices import ParametricMatrices

from .reduced_model import orthonormal_mixture


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class BasisSettings:
    """What a reduced model has to hold, and how much may be spent on it.

    Parameters
    ----------
    modes
        Number of lowest modes to keep.
    coordinates
        Most coordinates [1].
    span
        Largest absolute value of the parameters [1].
    tolerance
        Relative error of frequencies aimed at over the training parameters [1].
    training
        Random parameters from which the basis is chosen: three times the 30 to 60 parameters
        of usual models, below which rare combinations are missed.
    second_order
        Random parameters at which corrections of second order are found.
    guard
        Modes beyond `modes` among the candidates, which may come down with the parameters.
    storage_bytes
        Most memory for one set of candidates [bytes].
    seed
        Of the random parameters.
    """

    modes: int
    coordinates: int = 100
    span: float = 0.3
    tolerance: float = 1e-4
    training: int = 100
    second_order: int = 6
    guard: int = 6
    storage_bytes: float = 3e8
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse settings without a solution."""
        if not (0 < self.modes <= self.coordinates and 0.0 < self.span < 1.0):
            raise ValueError(
                f"modes={self.modes}, coordinates={self.coordinates}, span={self.span}. Allowed "
                "are at least one mode, as many coordinates as modes, and a span below 1, where "
                "a part has lost all stiffness."
            )


@dataclasses.dataclass(frozen=True, eq=False)
class _Start:
    """Nominal modes; A, its factors and the shift s in it."""

    nominal: SparseModes
    factor: SymmetricFactor
    weight: sparse.csr_array
    shift: float


@dataclasses.dataclass(frozen=True, eq=False)
class _Space:
    """Candidates, orthonormal in A, and the model projected on them."""

    vectors: np.ndarray
    stiffness: np.ndarray
    mass: np.ndarray
    stiffness_parts: np.ndarray
    mass_parts: np.ndarray

    def modes(self, theta: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        return scipy.linalg.eigh(
            self.stiffness + np.tensordot(theta, self.stiffness_parts, 1),
            self.mass + np.tensordot(theta, self.mass_parts, 1),
            subset_by_index=(0, min(count, len(self.mass)) - 1),
        )


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
    start = _start(model, settings)
    shapes = start.nominal.shapes
    exact = np.zeros((model.size, 0)) if exact is None else exact
    fixed = np.concatenate([shapes[:, : settings.modes], exact], axis=1)
    if not model.names:
        return _mass_orthonormal(model, fixed)
    random = np.random.default_rng(settings.seed)
    first = _first_order(model, start, settings, random)
    space = _space(model, start.weight, [shapes, exact, first])
    second = _second_order(model, space, start, settings, random)
    space = _space(model, start.weight, [space.vectors, second])
    chosen = _selected(start.weight, space, fixed, settings, random)
    return _mass_orthonormal(model, np.concatenate([fixed, chosen], axis=1))


def _start(model: ParametricMatrices, settings: BasisSettings) -> _Start:
    """Nominal modes, and A with its factors."""
    factor = SymmetricFactor(model.stiffness)
    count = min(settings.modes + settings.guard, model.size)
    if not factor.singular:
        nominal = lowest_modes(model.stiffness, model.mass, count, factor=factor)
        return _Start(nominal, factor, model.stiffness, 0.0)
    nominal = lowest_modes(model.stiffness, model.mass, count)
    elastic = nominal.eigenvalue[nominal.eigenvalue > 0.0]
    shift = float(elastic[0]) if elastic.size else 1.0
    weight = sparse.csr_array(model.stiffness + shift * model.mass)
    return _Start(nominal, SymmetricFactor(weight), weight, shift)


def _first_order(
    model: ParametricMatrices,
    start: _Start,
    settings: BasisSettings,
    random: np.random.Generator,
) -> np.ndarray:
    """Responses to the residual of each parameter, or of random mixtures of many."""
    nominal, factor, weight, shift = start.nominal, start.factor, start.weight, start.shift
    count, number = settings.modes, len(model.names)
    shapes, values = nominal.shapes[:, :count], nominal.eigenvalue[:count]
    most = max(8, int(settings.storage_bytes / (8 * model.size * count)))
    directions = np.eye(number)
    if number > most:
        directions = random.standard_normal((most, number))
    found = []
    for direction in directions:
        force = np.zeros_like(shapes)
        for i in np.flatnonzero(direction):
            force += direction[i] * model.stiffness_family.times(shapes, int(i))
            force -= direction[i] * model.mass_family.times(shapes * values, int(i))
        found.append(factor.solve(force))
    # Uniform parameters have a variance of span^2 / 3.
    size = settings.span * np.sqrt(number / (3.0 * len(directions)))
    scale = size / np.sqrt(values + shift)
    return _compressed(np.concatenate(found, axis=1) * np.tile(scale, len(found)), weight, settings.tolerance)


def _second_order(
    model: ParametricMatrices,
    space: _Space,
    start: _Start,
    settings: BasisSettings,
    random: np.random.Generator,
) -> np.ndarray:
    """Responses to the residuals that the candidates leave at random parameters."""
    found = []
    for _ in range(settings.second_order):
        theta = random.uniform(-settings.span, settings.span, len(model.names))
        stiffness, mass = model.at(theta)
        values, small = space.modes(theta, settings.modes)
        shapes = space.vectors @ small
        moved = start.factor.solve(stiffness @ shapes - (mass @ shapes) * values)
        found.append(moved / np.sqrt(values + start.shift))
    whole = np.concatenate([np.zeros((model.size, 0)), *found], axis=1)
    return _compressed(whole, start.weight, settings.second_order * settings.tolerance)


def _compressed(
    columns: np.ndarray, weight: sparse.csr_array, discarded: float
) -> np.ndarray:
    """Main directions of columns; what is left out has less than this sum of squares in A."""
    if not columns.size:
        return columns
    values, vectors = np.linalg.eigh(columns.T @ (weight @ columns))
    kept = np.cumsum(np.maximum(values, 0.0)) > discarded
    return np.asarray(columns @ vectors[:, kept])


def _space(
    model: ParametricMatrices, weight: sparse.csr_array, sets: list[np.ndarray]
) -> _Space:
    columns = np.concatenate(sets, axis=1)
    columns = columns @ orthonormal_mixture(columns.T @ (weight @ columns))
    return _Space(
        columns,
        columns.T @ (model.stiffness @ columns),
        columns.T @ (model.mass @ columns),
        model.stiffness_family.project(columns, columns),
        model.mass_family.project(columns, columns),
    )


def _selected(
    weight: sparse.csr_array,
    space: _Space,
    fixed: np.ndarray,
    settings: BasisSettings,
    random: np.random.Generator,
) -> np.ndarray:
    """Fewest directions beside the fixed ones that hold the modes of the training set."""
    inside = np.linalg.qr(space.vectors.T @ (weight @ fixed))[0]
    snapshots = []
    for _ in range(settings.training):
        theta = random.uniform(-settings.span, settings.span, len(space.stiffness_parts))
        _, small = space.modes(theta, settings.modes)
        # Coordinates are orthonormal in A, so the norm of a column is that in A.
        snapshots.append(small / np.linalg.norm(small, axis=0))
    left = np.concatenate(snapshots, axis=1)
    left = left - inside @ (inside.T @ left)
    directions, _, _ = np.linalg.svd(left, full_matrices=False)
    room = settings.coordinates - fixed.shape[1]
    # Frequencies err by half of the relative error of eigenvalues.
    captured = np.cumsum((directions.T @ left) ** 2, axis=0)
    missing = np.maximum(np.sum(left**2, axis=0) - captured, 0.0).max(axis=1) / 2.0
    enough = np.flatnonzero(missing <= settings.tolerance)
    count = min(int(enough[0]) + 1 if enough.size else len(missing), max(room, 0))
    return np.asarray(space.vectors @ directions[:, :count])


def _mass_orthonormal(model: ParametricMatrices, columns: np.ndarray) -> np.ndarray:
    return np.asarray(columns @ orthonormal_mixture(columns.T @ (model.mass @ columns)))

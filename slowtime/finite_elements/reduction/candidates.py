r"""Vectors from which reduced models over a range of parameters are made.

They are the nominal modes :math:`x_j`, and for each parameter the responses
:math:`A^{-1} K_p x_j` and :math:`A^{-1} \lambda_j M_p x_j` to the forces of its change, with
:math:`A = K_0 + s M_0` factorised once. Directions of little energy are left out by proper
orthogonal decomposition in the norm of A.

References
----------
.. [1] E. Balmès, "Parametric families of reduced finite element models. Theory and
   applications", Mechanical Systems and Signal Processing 10 (1996).
.. [2] A. Quarteroni, A. Manzoni, F. Negri, "Reduced Basis Methods for Partial Differential
   Equations", Springer (2016), chapter 6.
"""

import dataclasses

import numpy as np
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
        Relative error of frequencies aimed at [1].
    training
        Random parameters from which a fixed basis is chosen: three times the 30 to 60
        parameters of usual models, below which rare combinations are missed.
    guard
        Modes beyond `modes` in the candidates. The largest error of 20 frequencies of
        a frame with 30 groups at parameters up to 0.3 was 5e-4 with 6, 2e-4 with 10 and
        1.3e-4 with 14.
    storage_bytes
        Most memory for responses that are not compressed yet [bytes].
    seed
        Of the random parameters.
    """

    modes: int
    coordinates: int = 100
    span: float = 0.3
    tolerance: float = 1e-3
    training: int = 100
    guard: int = 10
    storage_bytes: float = 1e8
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse settings without a solution."""
        if not (0 < self.modes <= self.coordinates and 0.0 < self.span < 1.0):
            raise ValueError(
                f"modes={self.modes}, coordinates={self.coordinates}, span={self.span} are not "
                "allowed for a reduction. Give at least one mode, at least as many coordinates "
                "as modes, and a span between 0 and 1; at 1, a part would lose all stiffness."
            )


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class ReductionCandidates:
    """Candidates, orthonormal in A, and the model projected on them.

    Parameters
    ----------
    nominal
        Nominal modes, some beyond those to keep.
    weight, shift
        A, and the s in it [rad^2/s^2].
    stiffness, mass
        At zero parameters, over the candidates.
    stiffness_parts, mass_parts
        Parts by the parameters, over the candidates.
    """

    nominal: SparseModes
    weight: sparse.csr_array
    shift: float
    vectors: Float[np.ndarray, "own candidate"]
    stiffness: Float[np.ndarray, "candidate candidate"]
    mass: Float[np.ndarray, "candidate candidate"]
    stiffness_parts: Float[np.ndarray, "parameter candidate candidate"]
    mass_parts: Float[np.ndarray, "parameter candidate candidate"]

    def inside(self, columns: Float[np.ndarray, "own column"]) -> np.ndarray:
        """Coordinates over the candidates of columns that they hold."""
        return np.asarray(self.vectors.T @ (self.weight @ columns))


def candidates_of(
    model: ParametricMatrices,
    settings: BasisSettings,
    exact: Float[np.ndarray, "own exact"] | None = None,
) -> ReductionCandidates:
    """Find the candidates of a model.

    Vectors `exact`, such as static responses to loads, are held by them.
    """
    nominal, factor, shift = _start(model, settings)
    weight = sparse.csr_array(model.stiffness + shift * model.mass)
    extra = np.zeros((model.size, 0)) if exact is None else exact
    responses = _responses(model, nominal, factor, weight, settings)
    vectors = np.concatenate([nominal.shapes, extra, responses], axis=1)
    vectors = vectors @ orthonormal_mixture(vectors.T @ (weight @ vectors))
    return ReductionCandidates(
        nominal=nominal,
        weight=weight,
        shift=shift,
        vectors=vectors,
        stiffness=vectors.T @ (model.stiffness @ vectors),
        mass=vectors.T @ (model.mass @ vectors),
        stiffness_parts=model.stiffness_family.project(vectors, vectors),
        mass_parts=model.mass_family.project(vectors, vectors),
    )


def _start(
    model: ParametricMatrices, settings: BasisSettings
) -> tuple[SparseModes, SymmetricFactor, float]:
    """Nominal modes, factors of A, and the shift in it."""
    factor = SymmetricFactor(model.stiffness)
    count = min(settings.modes + settings.guard, model.size)
    if not factor.singular:
        nominal = lowest_modes(model.stiffness, model.mass, count, factor=factor)
        return nominal, factor, 0.0
    nominal = lowest_modes(model.stiffness, model.mass, count)
    elastic = nominal.eigenvalue[nominal.eigenvalue > 0.0]
    shift = float(elastic[0]) if elastic.size else 1.0
    weight = sparse.csr_array(model.stiffness + shift * model.mass)
    return nominal, SymmetricFactor(weight), shift


def _responses(
    model: ParametricMatrices,
    nominal: SparseModes,
    factor: SymmetricFactor,
    weight: sparse.csr_array,
    settings: BasisSettings,
) -> Float[np.ndarray, "own response"]:
    """Responses to the forces of all parameters, compressed as they are found."""
    shapes, values = nominal.shapes, nominal.eigenvalue
    shift = float(values[values > 0.0][:1].sum()) if (values == 0.0).any() else 0.0
    # Uniform parameters have a variance of span^2 / 3; energy counts relative to the mode's.
    scale = settings.span / np.sqrt(3.0 * (values + shift))
    inertia = shapes * (values + shift)
    kept, waiting = np.zeros((model.size, 0)), []
    parts = len(model.names)
    share = settings.tolerance / max(parts, 1)
    for p in range(parts):
        for family, right in ((model.stiffness_family, shapes), (model.mass_family, inertia)):
            force = family.times(right, p)
            if force.any():
                waiting.append(factor.solve(np.asfortranarray(force)) * scale)
        if sum(one.nbytes for one in waiting) > settings.storage_bytes or p == parts - 1:
            together = np.concatenate([kept, *waiting], axis=1)
            kept, waiting = compressed(together, weight, share * len(waiting)), []
    return kept


def compressed(
    columns: Float[np.ndarray, "own column"], weight: sparse.csr_array, discarded: float
) -> Float[np.ndarray, "own direction"]:
    """Find the main directions of columns, in their sizes.

    The norm has the matrix `weight`; `discarded` is the largest sum of squares left out.
    """
    if not columns.size:
        return columns
    values, vectors = np.linalg.eigh(columns.T @ (weight @ columns))
    kept = np.cumsum(np.maximum(values, 0.0)) > discarded
    return np.asarray(columns @ vectors[:, kept])

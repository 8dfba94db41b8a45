r"""A reduced model: projections of all matrices, linear in the parameters.

.. math:: K_r(\theta) = V^T K_0 V + \sum_i \theta_i V^T K_i V
"""

import dataclasses
import functools

import numpy as np
import scipy.linalg
from jaxtyping import Float
from scipy import sparse

from slowtime.finite_elements.degrees_of_freedom import DofMap
from slowtime.finite_elements.parametric_matrices import ParametricMatrices
from slowtime.finite_elements.sensitivities import ModeSlopes, SolvedModel, mode_slopes

DEPENDENT = 1e-12
"""Eigenvalue of the Gram matrix of a basis [1] below which a direction is left out: its square
root, 1e-6, is what projection of double-precision columns resolves."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ReductionError:
    """How far modes of a reduced model are from those of the full one.

    Parameters
    ----------
    modes
        Number of lowest modes compared.
    span
        Largest absolute value of the parameters that were tried [1].
    trials
        Number of random parameters.
    estimated
        Largest relative error of a frequency by the residual, without full solutions [1].
    frequency
        Largest relative error of a frequency against full solutions [1].
    agreement
        Smallest mass-weighted agreement of close modes as subspaces [1].
    """

    modes: int
    span: float
    trials: int
    estimated: float
    frequency: float
    agreement: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ReducedModes:
    """Modes of a reduced model.

    Parameters
    ----------
    eigenvalue
        Squares of angular frequencies, ascending [rad^2/s^2].
    """

    eigenvalue: Float[np.ndarray, " mode"]
    shapes: Float[np.ndarray, "coordinate mode"]

    @property
    def frequency_hz(self) -> Float[np.ndarray, " mode"]:
        """Natural frequencies [Hz]."""
        return np.asarray(np.sqrt(np.maximum(self.eigenvalue, 0.0)) / (2 * np.pi))


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ReducedModel:
    """Dense matrices over few coordinates, linear in the parameters.

    Parameters
    ----------
    stiffness, mass
        At zero parameters.
    names
        Of the parameters.
    stiffness_parts, mass_parts
        What a unit of each parameter adds.
    basis
        Full coordinates from reduced ones, one column for each.
    interface
        How many of the first coordinates are physical degrees of freedom.
    dofs
        What each degree of freedom is, before constraints; None where unknown.
    expansion
        Degrees of freedom before constraints, from those of the full matrices.
    damping
        At zero parameters; None where it is not modelled.
    error
        Found when the model was verified; None before.
    """

    stiffness: Float[np.ndarray, "coordinate coordinate"]
    mass: Float[np.ndarray, "coordinate coordinate"]
    names: tuple[str, ...]
    stiffness_parts: Float[np.ndarray, "parameter coordinate coordinate"]
    mass_parts: Float[np.ndarray, "parameter coordinate coordinate"]
    basis: Float[np.ndarray, "own coordinate"]
    interface: int = 0
    dofs: DofMap | None = None
    expansion: sparse.csr_array | None = None
    damping: Float[np.ndarray, "coordinate coordinate"] | None = None
    error: ReductionError | None = None

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return len(self.mass)

    @functools.cached_property
    def weighs(self) -> bool:
        """Whether any parameter acts on the mass."""
        return bool(np.any(self.mass_parts))

    def at(
        self, theta: Float[np.ndarray, " parameter"]
    ) -> tuple[
        Float[np.ndarray, "coordinate coordinate"], Float[np.ndarray, "coordinate coordinate"]
    ]:
        """Stiffness and mass at values of the parameters.

        Parameters
        ----------
        theta
            Relative changes of the parts [1].

        Returns
        -------
        Stiffness and mass over the reduced coordinates.
        """
        size = self.size
        flat = self.stiffness_parts.reshape(len(self.names), size * size)
        stiffness = self.stiffness + (theta @ flat).reshape(size, size)
        if not self.weighs:
            return stiffness, self.mass
        flat = self.mass_parts.reshape(len(self.names), size * size)
        return stiffness, self.mass + (theta @ flat).reshape(size, size)

    @functools.cached_property
    def _mass_is_unity(self) -> bool:
        return not self.weighs and np.allclose(self.mass, np.eye(self.size), atol=1e-10)

    def modes(self, theta: Float[np.ndarray, " parameter"], count: int) -> ReducedModes:
        """Lowest modes at values of the parameters.

        Parameters
        ----------
        theta
            Relative changes of the parts [1].
        count
            How many modes.

        Returns
        -------
        The modes, mass-normalised.
        """
        stiffness, mass = self.at(theta)
        values, shapes = scipy.linalg.eigh(
            stiffness,
            None if self._mass_is_unity else mass,
            subset_by_index=(0, min(count, self.size) - 1),
            check_finite=False,
        )
        return ReducedModes(eigenvalue=values, shapes=shapes)

    def sense(self, rows: Float[np.ndarray, "sensor dof"]) -> np.ndarray:
        """Sensor rows over the coordinates, from rows over all degrees of freedom."""
        own = rows if self.expansion is None else rows @ self.expansion
        return np.asarray(own @ self.basis)

    def slopes(
        self,
        theta: Float[np.ndarray, " parameter"],
        rows: Float[np.ndarray, "sensor coordinate"],
        count: int,
    ) -> tuple[ReducedModes, ModeSlopes]:
        """Lowest modes and their slopes by the parameters.

        Parameters
        ----------
        theta
            Relative changes of the parts [1].
        rows
            What each sensor sees of the coordinates.
        count
            How many modes.

        Returns
        -------
        The modes, and slopes of those modes.
        """
        found = self.modes(theta, self.size)
        solved = SolvedModel(
            eigenvalue=found.eigenvalue,
            shapes=found.shapes,
            stiffness_family=_DenseFamily(self.stiffness_parts),
            mass_family=_DenseFamily(self.mass_parts),
            weigh=self.mass.__matmul__,
            solve=np.zeros_like,
        )
        return lowest_with_slopes(solved, rows, count)


def lowest_with_slopes(
    solved: SolvedModel, rows: Float[np.ndarray, "sensor own"], count: int
) -> tuple[ReducedModes, ModeSlopes]:
    """Return the lowest modes of a solved model, and their slopes.

    There are fewer where the model has fewer.
    """
    wanted = np.arange(min(count, len(solved.eigenvalue)))
    lowest = ReducedModes(eigenvalue=solved.eigenvalue[wanted], shapes=solved.shapes[:, wanted])
    return lowest, mode_slopes(solved, rows, wanted)


@dataclasses.dataclass(frozen=True, slots=True)
class _DenseFamily:
    """Parts as a stack of matrices."""

    parts: np.ndarray

    @property
    def acts(self) -> bool:
        return bool(self.parts.any())

    def project(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        return np.asarray(left.T @ (self.parts @ right))

    def contract(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        found = np.einsum("ocj,poj->pcj", left, self.parts @ right, optimize=True)
        return np.asarray(found)


def project(
    model: ParametricMatrices,
    basis: Float[np.ndarray, "own coordinate"],
    *,
    interface: int = 0,
) -> ReducedModel:
    """Project a model onto a basis.

    Parameters
    ----------
    model
        The full model.
    basis
        One column for each reduced coordinate.
    interface
        How many of the first columns belong to physical degrees of freedom.

    Returns
    -------
    The reduced model.
    """
    return ReducedModel(
        stiffness=_symmetric(basis.T @ (model.stiffness @ basis)),
        mass=_symmetric(basis.T @ (model.mass @ basis)),
        names=model.names,
        stiffness_parts=model.stiffness_family.project(basis, basis),
        mass_parts=model.mass_family.project(basis, basis),
        basis=basis,
        interface=interface,
        dofs=model.dofs,
        expansion=model.expansion,
        damping=None
        if model.damping is None
        else _symmetric(basis.T @ (model.damping @ basis)),
    )


def orthonormal_mixture(gram: Float[np.ndarray, "column column"]) -> np.ndarray:
    """Mixture of columns that makes them orthonormal, largest direction first.

    Directions that depend on others are left out.
    """
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(gram * np.outer(scale, scale))
    kept = values > DEPENDENT * values[-1]
    mixture = scale[:, None] * vectors[:, kept] / np.sqrt(values[kept])
    return np.asarray(mixture[:, ::-1])


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    return np.asarray(0.5 * (matrix + matrix.T))

r"""Models that `estimate` can update: their modes at sensors, and slopes by the parameters.

Parameters are logarithms of factors, :math:`1 + \theta^{lin}_p = e^{\theta_p}`, so that
stiffness and mass stay positive; slopes are by the logarithms.
"""

import dataclasses
import functools
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from scipy import sparse

from slowtime.finite_elements.definiteness import indefinite_reduced_stiffness
from slowtime.finite_elements.parametric_matrices import ParametricMatrices
from slowtime.finite_elements.reduction import (
    AdaptiveModel,
    BasisSettings,
    ReducedModel,
    reduce_modal,
)
from slowtime.finite_elements.sensitivities import ModeSlopes
from slowtime.finite_elements.sparse_slopes import sparse_mode_slopes


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SensedModes:
    r"""Undamped modes as sensors see them, and how they change with the parameters.

    Parameters
    ----------
    eigenvalue
        Squares of angular frequencies, ascending, rigid motions left out [rad^2/s^2].
    sensed
        Mass-normalised shapes at the sensors, one column a mode.
    log_frequency_slope
        :math:`\partial \ln f_j / \partial \theta_p`.
    sensed_slope
        :math:`\partial (c^T x_j) / \partial \theta_p` of the shapes at the sensors.
    """

    eigenvalue: Float[np.ndarray, " mode"]
    sensed: Float[np.ndarray, "sensor mode"]
    log_frequency_slope: Float[np.ndarray, "mode parameter"]
    sensed_slope: Float[np.ndarray, "sensor mode parameter"]

    @property
    def frequency_hz(self) -> Float[np.ndarray, " mode"]:
        """Natural frequencies [Hz]."""
        return np.asarray(np.sqrt(self.eigenvalue) / (2.0 * np.pi))


@runtime_checkable
class UpdatableModel(Protocol):
    """A model whose parameters `estimate` can find."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of all parameters."""

    @property
    def element_names(self) -> tuple[str, ...]:
        """Of the parameters that act on the stiffness."""

    @property
    def node_names(self) -> tuple[str, ...]:
        """Of the parameters that act on the mass only."""

    @property
    def dof_names(self) -> tuple[str, ...]:
        """Of the degrees of freedom that sensors see."""

    @property
    def size(self) -> int:
        """Number of degrees of freedom that sensors see."""

    def sensed_modes(
        self,
        theta: Float[np.ndarray, " parameter"],
        sensors: Float[np.ndarray, "sensor dof"],
        count: int,
        added_mass: Float[np.ndarray, "dof dof"] | None = None,
    ) -> SensedModes:
        """At least `count` lowest elastic modes, where the model has as many."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class SparseStructure:
    """A sparse model, solved anew at each step; for chains and models up to some thousands.

    Parameters
    ----------
    matrices
        The model.
    """

    matrices: ParametricMatrices

    @property
    def names(self) -> tuple[str, ...]:
        """Of all parameters."""
        return self.matrices.names

    @functools.cached_property
    def element_names(self) -> tuple[str, ...]:
        """Of the parameters that act on the stiffness."""
        pairs = zip(self.names, self.matrices.stiffness_parts, strict=True)
        return tuple(name for name, part in pairs if part is not None)

    @functools.cached_property
    def node_names(self) -> tuple[str, ...]:
        """Of the parameters that act on the mass only."""
        return tuple(name for name in self.names if name not in set(self.element_names))

    @functools.cached_property
    def dof_names(self) -> tuple[str, ...]:
        """Of the degrees of freedom before constraints."""
        return _dof_names(self.matrices.dofs, self.size)

    @property
    def size(self) -> int:
        """Number of degrees of freedom before constraints."""
        expansion = self.matrices.expansion
        return self.matrices.size if expansion is None else int(expansion.shape[0])

    def sensed_modes(
        self,
        theta: Float[np.ndarray, " parameter"],
        sensors: Float[np.ndarray, "sensor dof"],
        count: int,
        added_mass: Float[np.ndarray, "dof dof"] | None = None,
    ) -> SensedModes:
        """Lowest elastic modes at sensors; see `UpdatableModel`."""
        rows = self.matrices.rows(sensors)
        added = None
        if added_mass is not None:
            added = sparse.csr_array(added_mass)
            if self.matrices.expansion is not None:
                added = self.matrices.expansion.T @ added @ self.matrices.expansion
        modes, slopes = sparse_mode_slopes(
            self.matrices, np.expm1(theta), rows, count, added_mass=added
        )
        return _by_logarithms(theta, modes.eigenvalue, rows @ modes.shapes, slopes)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ReducedStructure:
    """A reduced model; a step costs milliseconds whatever the size of the full one.

    Parameters
    ----------
    model
        The reduced model.
    node_names
        Of the parameters that act on the mass only.
    """

    model: ReducedModel | AdaptiveModel
    node_names: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Of all parameters."""
        return self.model.names

    @functools.cached_property
    def element_names(self) -> tuple[str, ...]:
        """Of the parameters that act on the stiffness."""
        return tuple(name for name in self.names if name not in set(self.node_names))

    @functools.cached_property
    def dof_names(self) -> tuple[str, ...]:
        """Of the degrees of freedom before constraints."""
        return _dof_names(self.model.dofs, self.size)

    @property
    def size(self) -> int:
        """Number of degrees of freedom before constraints."""
        expansion = self.model.expansion
        return len(self.model.basis) if expansion is None else int(expansion.shape[0])

    def sensed_modes(
        self,
        theta: Float[np.ndarray, " parameter"],
        sensors: Float[np.ndarray, "sensor dof"],
        count: int,
        added_mass: Float[np.ndarray, "dof dof"] | None = None,
    ) -> SensedModes:
        """Lowest elastic modes at sensors; see `UpdatableModel`."""
        rows, model = self.model.sense(sensors), self.model
        if added_mass is not None:
            over = model.sense(np.eye(self.size))
            model = dataclasses.replace(model, mass=model.mass + over.T @ added_mass @ over)
        try:
            modes, slopes = model.slopes(np.expm1(theta), rows, count)
        except np.linalg.LinAlgError:
            if not _is_indefinite(model.modes(np.expm1(theta), count).eigenvalue):
                raise
            raise _indefinite(model, theta) from None
        if _is_indefinite(modes.eigenvalue):
            raise _indefinite(model, theta)
        bent = modes.eigenvalue > _RIGID * modes.eigenvalue[-1]
        slopes = ModeSlopes(slopes.eigenvalue[bent], slopes.sensed[:, bent])
        sensed = rows @ modes.shapes[:, bent]
        return _by_logarithms(theta, modes.eigenvalue[bent], sensed, slopes)


SMALL = 3000
"""Degrees of freedom up to which every step solves the full model, in some 10 ms."""

_BEYOND = 10
"""Modes of a reduced model beyond those that were measured, for pairing and slopes."""


def updatable_model(matrices: ParametricMatrices, modes: int) -> UpdatableModel:
    """Choose what is solved at each step: a small model itself, a large one reduced.

    Parameters
    ----------
    matrices
        The model.
    modes
        Number of modes that were measured.

    Returns
    -------
    The model to be solved.
    """
    if matrices.size <= SMALL:
        return SparseStructure(matrices=matrices)
    number = min(modes + _BEYOND, matrices.size)
    settings = BasisSettings(modes=number, coordinates=max(100, 3 * number))
    return ReducedStructure(model=reduce_modal(matrices, settings, trials=0))


_RIGID = 1e-9
"""Eigenvalue over the highest used [1] of a motion that strains nothing."""

_NEGATIVE = -1e-6
"""Eigenvalue over the largest used [1] below which rounding does not explain its sign: bases
of 100 coordinates leave some 1e-12, matrices of six digits 1e-6."""


def _is_indefinite(eigenvalue: np.ndarray) -> bool:
    return bool(eigenvalue[0] < _NEGATIVE * np.abs(eigenvalue).max())


def _indefinite(model: ReducedModel | AdaptiveModel, theta: np.ndarray) -> ValueError:
    """Make the error that names the groups by which the stiffness is negative."""
    parts = model.stiffness_parts
    dense = parts if isinstance(parts, np.ndarray) else parts.dense()
    return indefinite_reduced_stiffness(model.names, model.stiffness, dense, np.expm1(theta))


def _by_logarithms(
    theta: np.ndarray, eigenvalue: np.ndarray, sensed: np.ndarray, slopes: ModeSlopes
) -> SensedModes:
    """Turn slopes by relative changes into slopes by logarithms of factors."""
    factor = np.exp(theta)
    return SensedModes(
        eigenvalue,
        np.asarray(sensed),
        slopes.eigenvalue * factor / (2.0 * eigenvalue[:, None]),
        slopes.sensed * factor,
    )


def _dof_names(dofs: object, size: int) -> tuple[str, ...]:
    names = getattr(dofs, "names", None)
    return names if names is not None else tuple(f"DOF {i + 1}" for i in range(size))

r"""Structure with variable element stiffnesses and node masses, and its modes.

.. math:: K(\theta) = K_0 + \sum_e (e^{\theta_e} - 1) K_e, \qquad
          M(\theta) = M_0 + \sum_n (e^{\theta_n} - 1) M_n

Logarithms keep stiffness and mass positive, and make a loss of half as far as a doubling.
"""

import dataclasses
import functools

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.linalg import eigh

from slowtime.finite_elements.parametric_matrices import ParametricMatrices

from .updatable_models import SensedModes, SparseStructure

_LARGE = 300  # degrees of freedom from which sparse solutions of few modes are the faster ones
_CHAIN = 20  # likewise where each part acts on few of them
_FEW = 0.1  # share of the entries of all parts that are not zero, below which they act on few
_SPARE = 2  # modes over modes needed, so that measured ones may be paired across others
_REPEATED = 1e-9  # relative distance of two eigenvalues whose vectors may turn freely
_RIGID = 1e-10  # eigenvalue over the largest, of a motion that strains nothing


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ParametricModes:
    r"""Undamped modes and how they change with the parameters.

    Parameters
    ----------
    eigenvalue
        Squares of angular frequencies, ascending, rigid motions left out [rad^2/s^2].
    shape
        Mass-normalised shapes, one column a mode.
    log_frequency_slope
        :math:`\partial \ln f_j / \partial \theta_p`.
    shape_slope
        :math:`\partial x_j / \partial \theta_p`, of the mass-normalised shapes.
    """

    eigenvalue: Float[np.ndarray, " mode"]
    shape: Float[np.ndarray, "dof mode"]
    log_frequency_slope: Float[np.ndarray, "mode parameter"]
    shape_slope: Float[np.ndarray, "dof mode parameter"]

    @property
    def frequency_hz(self) -> Float[np.ndarray, " mode"]:
        """Natural frequencies [Hz]."""
        return np.asarray(np.sqrt(self.eigenvalue) / (2.0 * np.pi))


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ParametricStructure:
    """Nominal matrices, and the parts of them that may change.

    Parameters
    ----------
    mass, stiffness
        Nominal matrices of the whole structure.
    stiffness_parts
        What each element adds to the stiffness, in its nominal state.
    element_names
        One per element; `spring 1` and so on when none are given.
    mass_parts
        What each node adds to the mass, if masses may change.
    node_names
        One per mass part; `mass 1` and so on when none are given.
    dof_names
        One per degree of freedom, where a sensor could be; `DOF 1` and so on by default.
    """

    mass: Float[np.ndarray, "dof dof"]
    stiffness: Float[np.ndarray, "dof dof"]
    stiffness_parts: Float[np.ndarray, "element dof dof"]
    element_names: tuple[str, ...] = ()
    mass_parts: Float[np.ndarray, "node dof dof"] | None = None
    node_names: tuple[str, ...] = ()
    dof_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Give names to what has none, and refuse matrices of no structure."""
        elements, nodes = len(self.stiffness_parts), len(self._masses)
        named = self.element_names or tuple(f"spring {i + 1}" for i in range(elements))
        noted = self.node_names or tuple(f"mass {i + 1}" for i in range(nodes))
        places = self.dof_names or tuple(f"DOF {i + 1}" for i in range(len(self.mass)))
        if (len(named), len(noted), len(places)) != (elements, nodes, len(self.mass)):
            raise ValueError(
                f"{len(named)} element names for {elements} stiffness parts, {len(noted)} node "
                f"names for {nodes} mass parts, {len(places)} names for {len(self.mass)} "
                "degrees of freedom. Give one name each, or none at all."
            )
        if len(set(named + noted)) < elements + nodes:
            raise ValueError(f"Names {named + noted} are not unique. Give each part its own.")
        object.__setattr__(self, "element_names", named)
        object.__setattr__(self, "node_names", noted)
        object.__setattr__(self, "dof_names", places)
        _check(self.mass, self.stiffness)

    @property
    def names(self) -> tuple[str, ...]:
        """Of all parameters: elements, then nodes."""
        return self.element_names + self.node_names

    @property
    def size(self) -> int:
        """Number of degrees of freedom."""
        return len(self.mass)

    @functools.cached_property
    def _masses(self) -> Float[np.ndarray, "node dof dof"]:
        return np.zeros((0, *self.mass.shape)) if self.mass_parts is None else self.mass_parts

    def matrices(
        self, theta: Float[np.ndarray, " parameter"]
    ) -> tuple[Float[np.ndarray, "dof dof"], Float[np.ndarray, "dof dof"]]:
        """Compute mass and stiffness at values of the parameters.

        Parameters
        ----------
        theta
            Logarithms of factors on the parts: first of elements, then of masses [1].

        Returns
        -------
        Mass and stiffness, in the units of the nominal matrices.
        """
        change = np.expm1(theta)
        elements = len(self.stiffness_parts)
        stiffness = self.stiffness + np.tensordot(change[:elements], self.stiffness_parts, 1)
        mass = self.mass + np.tensordot(change[elements:], self._masses, 1)
        return mass, stiffness

    def frequencies_hz(
        self, theta: Float[np.ndarray, " parameter"]
    ) -> Float[np.ndarray, " mode"]:
        """Natural frequencies of elastic modes, ascending, without shapes and slopes [Hz].

        Parameters
        ----------
        theta
            Logarithms of factors on the parts; 0 is nominal.
        """
        mass, stiffness = self.matrices(theta)
        values = eigh(stiffness, mass, eigvals_only=True)
        return np.asarray(np.sqrt(values[values > _RIGID * values[-1]]) / (2.0 * np.pi))

    def modes(
        self,
        theta: Float[np.ndarray, " parameter"],
        added_mass: Float[np.ndarray, "dof dof"] | None = None,
    ) -> ParametricModes:
        r"""Modes with parameters `theta`, and their slopes in closed form.

        .. math:: \frac{\partial \omega_j^2}{\partial p} &= x_j^T
                  \Big(\frac{\partial K}{\partial p}
                       - \omega_j^2 \frac{\partial M}{\partial p}\Big) x_j \\
                  \frac{\partial x_j}{\partial p} &= \sum_{r \ne j} x_r \,
                  \frac{x_r^T (\partial K / \partial p
                        - \omega_j^2 \, \partial M / \partial p) x_j}{\omega_j^2 - \omega_r^2}
                  - \tfrac{1}{2} \Big(x_j^T \frac{\partial M}{\partial p} x_j\Big) x_j

        Parameters
        ----------
        theta
            Logarithms of factors on the parts; 0 is nominal.
        added_mass
            A known mass put on the structure, whatever the parameters.

        Returns
        -------
        Eigenvalues [rad^2/s^2], shapes, and their slopes.

        References
        ----------
        .. [1] R. L. Fox, M. P. Kapoor, "Rates of change of eigenvalues and eigenvectors",
           AIAA Journal 6 (1968).
        """
        found = self._seen(theta, np.eye(self.size), self.size, added_mass)
        return ParametricModes(
            found.eigenvalue, found.sensed, found.log_frequency_slope, found.sensed_slope
        )

    def _seen(
        self,
        theta: Float[np.ndarray, " parameter"],
        rows: Float[np.ndarray, "sensor dof"],
        count: int,
        added_mass: Float[np.ndarray, "dof dof"] | None,
    ) -> SensedModes:
        """Lowest elastic modes and their slopes at sensors; all modes are in the sums."""
        mass, stiffness = self.matrices(theta)
        values, x = eigh(stiffness, mass if added_mass is None else mass + added_mass)
        which = np.flatnonzero(values > _RIGID * values[-1])[:count]
        lowest, order = x[:, which], np.arange(len(which))
        factor = np.exp(theta)
        elements = len(self.stiffness_parts)
        strained = x.T @ (self.stiffness_parts @ lowest) * factor[:elements, None, None]
        moved = x.T @ (self._masses @ lowest) * factor[elements:, None, None]
        eigenvalue = values[which]
        pulled = np.concatenate([strained, -eigenvalue * moved])
        own = pulled[:, which, order]
        gap = eigenvalue - values[:, None]
        far = np.abs(gap) > _REPEATED * values[-1]
        mixing = pulled * np.where(far, 1.0 / np.where(far, gap, 1.0), 0.0)
        mixing[elements:, which, order] -= 0.5 * moved[:, which, order]
        sensed = rows @ x
        return SensedModes(
            eigenvalue,
            sensed[:, which],
            (own / (2.0 * eigenvalue)).T,
            np.ascontiguousarray((sensed @ mixing).transpose(1, 2, 0)),
        )

    def sensed_modes(
        self,
        theta: Float[np.ndarray, " parameter"],
        sensors: Float[np.ndarray, "sensor dof"],
        count: int,
        added_mass: Float[np.ndarray, "dof dof"] | None = None,
    ) -> SensedModes:
        """Lowest elastic modes as sensors see them.

        Parameters
        ----------
        theta
            Logarithms of factors on the parts [1].
        sensors
            What each sensor sees of the degrees of freedom.
        count
            Number of modes needed at least.
        added_mass
            A known mass put on the structure [kg].

        Returns
        -------
        The modes and their slopes.
        """
        if self.size > _LARGE or (self.size > _CHAIN and self._acts_on_few):
            return self._sparse.sensed_modes(theta, sensors, count, added_mass)
        return self._seen(theta, sensors, _SPARE * count, added_mass)

    @functools.cached_property
    def _acts_on_few(self) -> bool:
        parts = self.stiffness_parts
        return bool(np.count_nonzero(parts) < _FEW * parts.size)

    @functools.cached_property
    def _sparse(self) -> SparseStructure:
        """The same structure by sparse matrices, without the zeros of its parts."""
        elements, nodes = len(self.element_names), len(self.node_names)
        return SparseStructure(
            matrices=ParametricMatrices(
                stiffness=sparse.csr_array(self.stiffness),
                mass=sparse.csr_array(self.mass),
                names=self.names,
                stiffness_parts=(
                    *(sparse.csr_array(part) for part in self.stiffness_parts),
                    *(None,) * nodes,
                ),
                mass_parts=(
                    *(None,) * elements,
                    *(sparse.csr_array(part) for part in self._masses),
                ),
            )
        )


def _check(mass: Float[np.ndarray, "dof dof"], stiffness: Float[np.ndarray, "dof dof"]) -> None:
    for name, matrix in (("mass", mass), ("stiffness", stiffness)):
        if not np.allclose(matrix, matrix.T, rtol=1e-9, atol=1e-9 * np.abs(matrix).max()):
            raise ValueError(f"The {name} matrix is not symmetric. Give a symmetric one.")
    if not np.linalg.eigvalsh(mass)[0] > 0.0:
        raise ValueError(
            "The mass matrix is not positive definite: a degree of freedom has no mass. "
            "Condense it out, or give it a mass."
        )

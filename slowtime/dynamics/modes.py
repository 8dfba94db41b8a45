r"""Real and complex modes of structures with viscous damping.

.. math:: K x_j = \omega_j^2 M x_j, \qquad (s_j^2 M + s_j C + K) z_j = 0 .
"""

import dataclasses

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from .damping import is_proportional
from .structure import Structure, state_matrix

ROUNDING = 100 * float(np.finfo(float).eps)
"""Relative size per mode below which an eigenvalue is taken for zero: a rigid-body motion."""

DEFECT = 1e-6
"""Relative norm below which two modes are so alike that their sum loses its digits."""

STILL = 1e-7
"""Pole, relative to the largest, that cannot be told from a drift: rounding makes such."""


class DefectiveModesError(ValueError):
    """Modes that do not span all motion; what needs no modes still works."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Modes:
    r"""Undamped modes, ascending, mass-normalised: :math:`x_j^T M x_l = \delta_{jl}`."""

    angular_frequency: Float[np.ndarray, " mode"]
    shapes: Float[np.ndarray, "dof mode"]

    @property
    def frequency_hz(self) -> Float[np.ndarray, " mode"]:
        """Natural frequencies [Hz]."""
        return np.asarray(self.angular_frequency / (2 * np.pi))


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ComplexModes:
    r"""Modes of a damped structure, scaled so that :math:`z_j^T (2 s_j M + C) z_j = \gamma_j`.

    Parameters
    ----------
    poles
        :math:`s_j` in the upper half plane, ascending in natural frequency [1/s]; each stands
        for its conjugate too.
    shapes
        :math:`z_j`.
    norms
        :math:`\gamma_j = 2 i \operatorname{Im} s_j`, with which the modes of a proportionally
        damped structure are real and mass-normalised (the book's :math:`2 s_j` turns them by a
        phase).
    real_poles, real_shapes, real_norms
        The same of overdamped motions, each of which stands for itself alone.
    """

    poles: Complex[np.ndarray, " mode"]
    shapes: Complex[np.ndarray, "dof mode"]
    norms: Complex[np.ndarray, " mode"]
    real_poles: Float[np.ndarray, " real"]
    real_shapes: Float[np.ndarray, "dof real"]
    real_norms: Float[np.ndarray, " real"]

    @property
    def angular_frequency(self) -> Float[np.ndarray, " mode"]:
        r"""Undamped natural frequencies :math:`|s_j|` [rad/s]."""
        return np.asarray(np.abs(self.poles))

    @property
    def frequency_hz(self) -> Float[np.ndarray, " mode"]:
        r"""Undamped natural frequencies :math:`|s_j| / 2 \pi` [Hz]."""
        return np.asarray(np.abs(self.poles) / (2 * np.pi))

    @property
    def damping_ratio(self) -> Float[np.ndarray, " mode"]:
        r""":math:`\zeta_j = -\operatorname{Re} s_j / |s_j|` [1]."""
        return np.asarray(-self.poles.real / np.abs(self.poles))

    @property
    def complex_frequency(self) -> Complex[np.ndarray, " mode"]:
        r""":math:`\lambda_j = s_j / i` (eq. 3.213) [rad/s]."""
        return np.asarray(self.poles / 1j)

    def all(
        self,
    ) -> tuple[
        Complex[np.ndarray, " pole"],
        Complex[np.ndarray, "dof pole"],
        Complex[np.ndarray, " pole"],
    ]:
        """Poles, shapes and norms of all 2 N motions: pairs, their conjugates, real ones."""
        return (
            np.concatenate([self.poles, self.poles.conj(), self.real_poles]),
            np.concatenate([self.shapes, self.shapes.conj(), self.real_shapes], axis=1),
            np.concatenate([self.norms, self.norms.conj(), self.real_norms]),
        )


def undamped_modes(structure: Structure) -> Modes:
    """Natural frequencies and mode shapes without damping (eq. 3.55).

    Angular frequencies are in rad/s, ascending; shapes are mass-normalised. Raises `ValueError`
    if the structure is statically unstable.

    Examples
    --------
    >>> pair = Structure(mass=np.eye(2), damping=np.zeros((2, 2)),
    ...                  stiffness=np.array([[2.0, -1.0], [-1.0, 2.0]]))
    >>> undamped_modes(pair).angular_frequency.round(6)
    array([1.      , 1.732051])
    """
    squares, shapes = scipy.linalg.eigh(structure.stiffness, structure.mass)
    nothing = ROUNDING * len(squares) * np.abs(squares).max()
    if squares[0] < -nothing:
        raise ValueError(
            f"The stiffness matrix has a negative eigenvalue (omega^2 = {squares[0]:.4g}): the "
            "structure is unstable at rest and has no natural frequency there. Check the signs."
        )
    squares = np.where(squares < nothing, 0.0, squares)
    return Modes(angular_frequency=np.sqrt(squares), shapes=shapes * _signs(shapes))


def complex_modes(structure: Structure) -> ComplexModes:
    r"""Modes with damping, from the state space (eq. 3.198 to 3.211).

    Modes of proportional damping are taken from the undamped ones, so that repeated
    frequencies do no harm. All are checked by an identity over the 2 N motions,

    .. math:: \sum_j s_j z_j z_j^T / \gamma_j = M^{-1} .

    Raises
    ------
    DefectiveModesError
        (a ValueError) Where the modes do not span all motion, as at critical damping or with
        a free rigid-body motion. `simulation.simulate_structure` does without them.
    """
    if is_proportional(structure):
        modes = _proportional(structure)
    else:
        modes = _general(structure)
    _check_spanning(structure, modes)
    return modes


def _proportional(structure: Structure) -> ComplexModes:
    real = undamped_modes(structure)
    omega, shapes = real.angular_frequency, real.shapes
    rate = np.einsum("aj,ab,bj->j", shapes, structure.damping, shapes) / 2
    ringing = omega > np.abs(rate)
    under, over = np.flatnonzero(ringing), np.flatnonzero(~ringing)
    root = np.sqrt(np.maximum(rate[over] ** 2 - omega[over] ** 2, 0.0))
    # The smaller root as a quotient: the difference of the two would cancel.
    fast = -(rate[over] + np.copysign(root, rate[over]))
    slow = omega[over] ** 2 / np.where(fast == 0, 1.0, fast)
    poles = -rate[under] + 1j * np.sqrt(omega[under] ** 2 - rate[under] ** 2)
    return ComplexModes(
        poles=poles,
        shapes=shapes[:, under].astype(complex),
        norms=2j * poles.imag,
        real_poles=np.concatenate([slow, fast]),
        real_shapes=np.concatenate([shapes[:, over]] * 2, axis=1),
        real_norms=np.concatenate([slow - fast, fast - slow]),
    )


def _general(structure: Structure) -> ComplexModes:
    dofs = structure.dofs
    poles, vectors = scipy.linalg.eig(state_matrix(structure))
    shapes = vectors[:dofs]
    order = np.lexsort((poles.imag, np.abs(poles)))
    poles, shapes = poles[order], shapes[:, order]
    upper, flat = poles.imag > 0, poles.imag == 0
    norms = _norms(structure, poles, shapes)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.sqrt(2j * poles[upper].imag / norms[upper])
    z = shapes[:, upper] * scale
    real = shapes[:, flat].real
    return ComplexModes(
        poles=poles[upper],
        shapes=z * _signs(z.real),
        norms=2j * poles[upper].imag,
        real_poles=poles[flat].real,
        real_shapes=real,
        real_norms=norms[flat].real,
    )


def _norms(
    structure: Structure,
    poles: Complex[np.ndarray, " mode"],
    shapes: Complex[np.ndarray, "dof mode"],
) -> Complex[np.ndarray, " mode"]:
    """Compute the constants of eq. 3.211."""
    mass = np.einsum("aj,ab,bj->j", shapes, structure.mass, shapes)
    damping = np.einsum("aj,ab,bj->j", shapes, structure.damping, shapes)
    return np.asarray(2 * poles * mass + damping)


def _check_spanning(structure: Structure, modes: ComplexModes) -> None:
    poles, shapes, norms = modes.all()
    inverse, size = scipy.linalg.inv(structure.mass), np.abs(poles)
    kinetic = np.einsum("aj,ab,bj->j", shapes.conj(), structure.mass, shapes).real
    with np.errstate(all="ignore"):
        alike = np.abs(norms / (2 * size * kinetic)).min()
        found = np.real((shapes * (poles / norms)) @ shapes.T)
        error = np.abs(found - inverse).max() / np.abs(inverse).max()
    if not (alike > DEFECT and error < DEFECT and size.min() > STILL * size.max()):
        raise DefectiveModesError(
            "The modes do not span all motion: two poles coincide, as at critical damping or "
            "in a rigid-body motion. Use simulation.simulate_structure and "
            "transfer.frequency_response, which need no modes."
        )


def _signs(shapes: Float[np.ndarray, "dof mode"]) -> Float[np.ndarray, " mode"]:
    """Sign of each shape's largest component, the first of those of nearly equal size."""
    size = np.abs(shapes)
    first = np.argmax(size > (1 - 1e-6) * size.max(axis=0), axis=0)
    signs = np.sign(shapes[first, np.arange(shapes.shape[1])])
    return np.where(signs == 0, 1.0, signs)

r"""Transfer functions :math:`H(s) = (s^2 M + s C + K)^{-1}` and frequency responses."""

import numpy as np
from jaxtyping import Complex, Float

from .structure import Structure

Omega = Float[np.ndarray, " frequency"]
Laplace = Complex[np.ndarray, " frequency"]
Transfer = Complex[np.ndarray, "frequency output input"]
QUANTITIES = ("displacement", "velocity", "acceleration")


def transfer_function(structure: Structure, s: Laplace) -> Transfer:
    """Displacement per force at points of the Laplace plane.

    Examples
    --------
    >>> two = Structure(mass=np.eye(2), damping=np.zeros((2, 2)), stiffness=np.diag([4.0, 9.0]))
    >>> transfer_function(two, np.array([0j])).real
    array([[[0.25      , 0.        ],
            [0.        , 0.11111111]]])
    """
    point = s[:, None, None]
    return np.asarray(
        np.linalg.inv(
            point**2 * structure.mass + point * structure.damping + structure.stiffness
        )
    )


def frequency_response(
    structure: Structure, omega: Omega, quantity: str = "displacement"
) -> Transfer:
    r"""Response per force at angular frequencies [rad/s]: :math:`(i\omega)^n H(i \omega)`.

    Motion is relative to the base.
    """
    scale = (1j * omega) ** derivative_order(quantity)
    return np.asarray(scale[:, None, None] * transfer_function(structure, 1j * omega))


def laplace_response(
    structure: Structure,
    s: Laplace,
    *,
    force: Complex[np.ndarray, "frequency dof"] | None = None,
    displacement: Float[np.ndarray, " dof"] | None = None,
    velocity: Float[np.ndarray, " dof"] | None = None,
) -> Complex[np.ndarray, "frequency dof"]:
    r"""Laplace transform of the displacement, from any initial state under any force [m s].

    .. math:: \bar q(s) = H(s) \{ \bar f(s) + M \dot q_0 + C q_0 + s M q_0 \}

    Eq. 3.237; on the imaginary axis, eq. 3.134, the frequency response of figures 3.6 to 3.10.
    """
    rest = np.zeros(structure.dofs)
    q0 = rest if displacement is None else displacement
    v0 = rest if velocity is None else velocity
    moved = structure.mass @ v0 + structure.damping @ q0 + np.outer(s, structure.mass @ q0)
    pushed = moved if force is None else moved + force
    return np.asarray(np.einsum("fab,fb->fa", transfer_function(structure, s), pushed))


def derivative_order(quantity: str) -> int:
    """Count the time derivatives from displacement to a quantity: 0, 1 or 2."""
    if quantity not in QUANTITIES:
        raise ValueError(f"{quantity=} is not known. Allowed: {', '.join(QUANTITIES)}.")
    return QUANTITIES.index(quantity)

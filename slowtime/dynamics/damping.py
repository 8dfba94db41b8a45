r"""Damping: coefficients of Rayleigh, matrices of modal damping ratios, proportionality.

Each gives a matrix that the undamped modes :math:`X` make diagonal,

.. math:: X^T C X = \operatorname{diag}(2 \zeta_j \omega_j) ,

so that motion stays a sum of real modes (section 3.4). The book's text of these equations is
lost; the forms here are derived anew, and each is checked against this very property.
"""

import numpy as np
import scipy.linalg
import scipy.optimize
from jaxtyping import Float

from .structure import Structure

Square = Float[np.ndarray, "dof dof"]
Series = Float[np.ndarray, " mode"]

COMMUTING = 1e-10
"""Relative difference of Caughey and O'Kelly's products below which it is rounding."""


def non_proportionality(structure: Structure) -> float:
    r"""Relative deviation from the condition of Caughey and O'Kelly.

    Real modes exist exactly where :math:`C M^{-1} K = K M^{-1} C`.

    It is 0 for proportional damping.

    Examples
    --------
    >>> pair = np.array([[2.0, -1.0], [-1.0, 2.0]])
    >>> alike = Structure(mass=np.eye(2), damping=0.1 * pair, stiffness=pair)
    >>> non_proportionality(alike)
    0.0
    """
    product = structure.damping @ scipy.linalg.solve(
        structure.mass, structure.stiffness, assume_a="pos"
    )
    largest = np.abs(product).max()
    return float(np.abs(product - product.T).max() / largest) if largest > 0 else 0.0


def is_proportional(structure: Structure) -> bool:
    """Whether damping leaves the undamped modes uncoupled (Caughey and O'Kelly)."""
    return non_proportionality(structure) < COMMUTING


def rayleigh_coefficients(
    frequencies: tuple[float, float], damping_ratios: tuple[float, float]
) -> tuple[float, float]:
    r"""Coefficients of :math:`C = a_0 M + a_1 K` that give two modes their damping ratios.

    .. math:: \zeta_j = \tfrac12 (a_0 / \omega_j + a_1 \omega_j)

    Examples
    --------
    >>> rayleigh_coefficients((1.0, 3.0), (0.125, 0.375))
    (0.0, 0.25)
    """
    (w1, w2), (z1, z2) = frequencies, damping_ratios
    if not (w1 > 0 and w2 > 0 and w1 != w2):
        raise ValueError(
            f"{frequencies=} do not fix two coefficients. Give two different "
            "frequencies above 0."
        )
    span = w2**2 - w1**2
    return 2 * w1 * w2 * (z1 * w2 - z2 * w1) / span, 2 * (z2 * w2 - z1 * w1) / span


def modal_damping(mass: Square, stiffness: Square, damping_ratios: Series | float) -> Square:
    r"""Damping matrix that gives each undamped mode its damping ratio [N s/m].

    .. math:: C = M X \operatorname{diag}(2 \zeta_j \omega_j) X^T M
    """
    squares, shapes = scipy.linalg.eigh(stiffness, mass)
    omega = np.sqrt(np.maximum(squares, 0.0))
    return _from_modes(mass, shapes, 2 * np.broadcast_to(damping_ratios, omega.shape) * omega)


def _from_modes(mass: Square, shapes: Float[np.ndarray, "dof mode"], rate: Series) -> Square:
    moved = mass @ shapes
    return np.asarray((moved * rate) @ moved.T)

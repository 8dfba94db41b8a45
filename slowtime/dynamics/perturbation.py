r"""Complex modes by first-order perturbation in the damping (section 3.5.1.2).

All of them start from the undamped modes and :math:`C' = X^T C X`. They say how complex modes
come about; `modes.complex_modes` is exact, and for structures of a size that fits in memory no
slower than it matters.
"""

import numpy as np
from jaxtyping import Complex, Float

from .modes import Modes, undamped_modes
from .structure import Structure

Frequencies = Complex[np.ndarray, " mode"]
Shapes = Complex[np.ndarray, "dof mode"]


def modal_damping_matrix(structure: Structure, modes: Modes) -> Float[np.ndarray, "mode mode"]:
    """Compute :math:`C' = X^T C X`."""
    return np.asarray(modes.shapes.T @ structure.damping @ modes.shapes)


def light_frequencies(structure: Structure) -> Frequencies:
    r"""Complex frequencies :math:`\omega_j + i C'_{jj} / 2` (eq. 3.217) [rad/s]."""
    modes = undamped_modes(structure)
    return modes.angular_frequency + 0.5j * np.diag(modal_damping_matrix(structure, modes))


def uncoupled_frequencies(structure: Structure) -> Frequencies:
    r"""Complex frequencies without the coupling of modes by damping.

    .. math:: \lambda_j \approx i C'_{jj} / 2 + \sqrt{\omega_j^2 - C'^2_{jj} / 4}

    The root of eq. 3.216 before it is expanded; of eq. 3.217 to first order in the damping.
    """
    modes = undamped_modes(structure)
    half = np.diag(modal_damping_matrix(structure, modes)) / 2
    return np.asarray(1j * half + np.sqrt(modes.angular_frequency**2 - half**2 + 0j))


def light_shapes(structure: Structure) -> Shapes:
    r"""Shapes for light damping, their imaginary part of first order (eq. 3.219).

    .. math:: z_j \approx x_j +
        \sum_{k \ne j} \frac{i \omega_j C'_{kj}}{\omega_j^2 - \omega_k^2} x_k

    Of no use where two frequencies are close.
    """
    modes = undamped_modes(structure)
    omega = modes.angular_frequency
    coupling = modal_damping_matrix(structure, modes)
    gap = omega[None, :] ** 2 - omega[:, None] ** 2
    return _mixed(modes, 1j * omega[None, :] * coupling, gap.astype(complex))


def coupled_shapes(structure: Structure, frequencies: Frequencies | None = None) -> Shapes:
    r"""Shapes for damping that is not light, but nearly proportional (eq. 3.221).

    .. math:: z_j \approx x_j - \sum_{k \ne j}
        \frac{i \lambda_j C'_{kj}}{\omega_k^2 - \lambda_j^2 + i \lambda_j C'_{kk}} x_k
    """
    modes = undamped_modes(structure)
    coupling = modal_damping_matrix(structure, modes)
    found = light_frequencies(structure) if frequencies is None else frequencies
    own = found[None, :]
    gap = modes.angular_frequency[:, None] ** 2 - own**2 + 1j * own * np.diag(coupling)[:, None]
    return _mixed(modes, -1j * own * coupling, gap)


def factored_shapes(structure: Structure, frequencies: Frequencies | None = None) -> Shapes:
    r"""Eq. 3.224 as it ought to be, with the denominator of eq. 3.221 in factors.

    .. math:: z_j \approx x_j + \sum_{k \ne j} \frac{i \lambda_j C'_{kj}}
        {(\lambda_j - \lambda_k)(\lambda_j + \lambda_k^*)} x_k

    The print has :math:`\lambda_j - \lambda_k^*`: but the roots of
    :math:`\lambda^2 - i \lambda C'_{kk} - \omega_k^2` are :math:`\lambda_k` and
    :math:`-\lambda_k^*`, and only with them do the numbers of eq. 3.226 come out.
    """
    modes = undamped_modes(structure)
    coupling = modal_damping_matrix(structure, modes)
    found = light_frequencies(structure) if frequencies is None else frequencies
    own, other = found[None, :], found[:, None]
    return _mixed(modes, 1j * own * coupling, (own - other) * (own + other.conj()))


def _mixed(
    modes: Modes,
    numerator: Complex[np.ndarray, "mode mode"],
    gap: Complex[np.ndarray, "mode mode"],
) -> Shapes:
    """Undamped shapes, each with its admixture of the others: entry k, j is of x_k in z_j."""
    others = ~np.eye(len(gap), dtype=bool)
    if np.any(gap[others] == 0):
        raise ValueError(
            "Two natural frequencies are equal, for which a perturbation has no answer. Use "
            "modes.complex_modes."
        )
    share = np.where(others, numerator / np.where(others, gap, 1.0), 1.0)
    return np.asarray(modes.shapes @ share)

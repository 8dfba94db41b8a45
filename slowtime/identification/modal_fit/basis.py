r"""Functions of frequency of which a frequency response is a sum: poles and residual terms.

With poles :math:`\lambda_k` and residues :math:`R_k`, a frequency response is

.. math:: H(s) = s^p \sum_k \left( \frac{R_k}{s - \lambda_k}
          + \frac{R_k^*}{s - \lambda_k^*} \right) + \sum_q c_q s^q ,

with p = 0, 1, 2 for displacement, velocity, acceleration per force. The real residual terms
stand for modes below the band (their mass line) and above it (their stiffness line).

References
----------
.. [1] W. Heylen, S. Lammens, P. Sas, "Modal Analysis Theory and Testing", KU Leuven (1997),
   section A.3: lower and upper residuals.
"""

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification.frequency_response.response import Kind

POWER: dict[Kind, int] = {
    "displacement": 0,
    "velocity": 1,
    "acceleration": 2,
    "transmissibility": 0,
}
"""Power p of s before the sum over poles."""

RESIDUAL_POWERS: dict[Kind, tuple[int, ...]] = {
    "displacement": (-2, 0),
    "velocity": (-1, 1),
    "acceleration": (0, 2),
    "transmissibility": (0, 1, 2),
}
"""Powers q of the residual terms. A transmissibility has no mass line: it is 1 at rest."""

END_POWERS = (0, 1)
"""Powers of the smooth part of the spectrum of what a record does not end with [1]."""


def modal_columns(
    s: Complex[np.ndarray, " row"], poles: Complex[np.ndarray, " mode"], power: int
) -> Complex[np.ndarray, "row column"]:
    """Columns that multiply the real parts, then the imaginary parts, of the residues.

    One column a mode for the real parts, then one a mode for the imaginary parts.
    """
    factor = s[:, None] ** power
    own = factor / (s[:, None] - poles)
    mirrored = factor / (s[:, None] - poles.conj())
    return np.concatenate([own + mirrored, 1j * (own - mirrored)], axis=1)


def residual_columns(
    s: Complex[np.ndarray, " row"], powers: tuple[int, ...]
) -> Complex[np.ndarray, "row term"]:
    """Powers of s."""
    return np.stack([s**power for power in powers], axis=1)


def response_columns(
    s: Complex[np.ndarray, " row"], poles: Complex[np.ndarray, " mode"], kind: Kind
) -> Complex[np.ndarray, "row column"]:
    """Columns of a frequency response: those of the residues, then its residual terms."""
    own = modal_columns(s, poles, POWER[kind])
    return np.concatenate([own, residual_columns(s, RESIDUAL_POWERS[kind])], axis=1)


def pole_derivatives(
    s: Complex[np.ndarray, " row"],
    poles: Complex[np.ndarray, " mode"],
    power: int,
    residues: Complex[np.ndarray, " mode"],
) -> Complex[np.ndarray, "row parameter"]:
    """Return derivatives of the sum over poles by real, then by imaginary parts of the poles.

    One column a mode for the real parts, then one a mode for the imaginary parts.
    """
    factor = s[:, None] ** power
    own = factor * residues / (s[:, None] - poles) ** 2
    mirrored = factor * residues.conj() / (s[:, None] - poles.conj()) ** 2
    return np.concatenate([own + mirrored, 1j * (own - mirrored)], axis=1)


def pole_quantities(
    poles: Complex[np.ndarray, " mode"],
) -> tuple[
    Float[np.ndarray, " mode"], Float[np.ndarray, " mode"], Float[np.ndarray, "mode 2 2"]
]:
    """Undamped natural frequency, damping ratio, and their derivatives by the pole.

    In Hz and 1; the derivatives are by (real part, imaginary part) of each pole [rad/s].
    """
    size = np.abs(poles)
    damping = -poles.real / size
    turning = poles.imag / size
    derivative = np.empty((len(poles), 2, 2))
    derivative[:, 0, 0] = -damping / (2 * np.pi)
    derivative[:, 0, 1] = turning / (2 * np.pi)
    derivative[:, 1, 0] = -(1 - damping**2) / size
    derivative[:, 1, 1] = -damping * turning / size
    return size / (2 * np.pi), damping, derivative

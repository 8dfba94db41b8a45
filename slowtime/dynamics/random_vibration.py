"""Filters that colour white noise: densities of random forces and of ground motion."""

import dataclasses
import math

import numpy as np
from jaxtyping import Float

Frequencies = Float[np.ndarray, " frequency"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Shaping:
    r"""Filter that colours white noise, :math:`\dot y = A y + b w, \; f = c^T y`.

    Parameters
    ----------
    state_matrix, input_vector, output_vector
        :math:`A`, all its eigenvalues in the left half plane, :math:`b`, :math:`c`.

    Notes
    -----
    The output has the density :math:`|c^T (i \omega - A)^{-1} b|^2` times that of the noise.
    """

    state_matrix: Float[np.ndarray, "state state"]
    input_vector: Float[np.ndarray, " state"]
    output_vector: Float[np.ndarray, " state"]

    def density(self, frequency_hz: Frequencies) -> Frequencies:
        """Gain of the filter in a spectral density [1]."""
        s = 2j * np.pi * frequency_hz[:, None, None]
        inner = s * np.eye(len(self.state_matrix)) - self.state_matrix
        gain = self.output_vector @ np.linalg.inv(inner) @ self.input_vector
        return np.asarray(np.abs(gain) ** 2)


def low_pass(corner_hz: float) -> Shaping:
    r"""First-order low-pass filter (Ornstein–Uhlenbeck), :math:`1 / (1 + (f / f_c)^2)`."""
    corner = 2 * math.pi * corner_hz
    return Shaping(np.array([[-corner]]), np.array([corner]), np.array([1.0]))


def kanai_tajimi(frequency_hz: float, damping_ratio: float) -> Shaping:
    r"""Kanai–Tajimi filter of ground motion.

    .. math:: \frac{1 + (2 \zeta r)^2}{(1 - r^2)^2 + (2 \zeta r)^2}, \qquad r = f / f_g
    """
    omega = 2 * math.pi * frequency_hz
    return Shaping(
        np.array([[0.0, 1.0], [-(omega**2), -2 * damping_ratio * omega]]),
        np.array([0.0, 1.0]),
        np.array([omega**2, 2 * damping_ratio * omega]),
    )

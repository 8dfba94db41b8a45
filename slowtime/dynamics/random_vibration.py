r"""Spectra and covariances of the response to random forces.

Densities are one-sided, per hertz: white force of density :math:`S` has

.. math:: E[f(t) f(t')^T] = \tfrac12 S \, \delta(t - t') .
"""

import dataclasses
import math

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float, Inexact

from .simulation import density_root, force_density
from .structure import Structure, state_matrix
from .transfer import frequency_response

Square = Float[np.ndarray, "dof dof"]
ForceDensity = float | Float[np.ndarray, " dof"] | Square
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
        """Gain of the filter in a spectral density.

        Parameters
        ----------
        frequency_hz
            Frequencies [Hz].

        Returns
        -------
        Gain [1].
        """
        s = 2j * np.pi * frequency_hz[:, None, None]
        inner = s * np.eye(len(self.state_matrix)) - self.state_matrix
        gain = self.output_vector @ np.linalg.inv(inner) @ self.input_vector
        return np.asarray(np.abs(gain) ** 2)


def low_pass(corner_hz: float) -> Shaping:
    r"""First-order low-pass filter (Ornstein–Uhlenbeck), :math:`1 / (1 + (f / f_c)^2)`.

    Parameters
    ----------
    corner_hz
        Corner frequency :math:`f_c` [Hz].

    Returns
    -------
    Filter.
    """
    corner = 2 * math.pi * corner_hz
    return Shaping(np.array([[-corner]]), np.array([corner]), np.array([1.0]))


def kanai_tajimi(frequency_hz: float, damping_ratio: float) -> Shaping:
    r"""Kanai–Tajimi filter of ground motion.

    .. math:: \frac{1 + (2 \zeta r)^2}{(1 - r^2)^2 + (2 \zeta r)^2}, \qquad r = f / f_g

    Parameters
    ----------
    frequency_hz
        Natural frequency of the soil layer [Hz].
    damping_ratio
        Its damping ratio [1].

    Returns
    -------
    Filter.
    """
    omega = 2 * math.pi * frequency_hz
    return Shaping(
        np.array([[0.0, 1.0], [-(omega**2), -2 * damping_ratio * omega]]),
        np.array([0.0, 1.0]),
        np.array([omega**2, 2 * damping_ratio * omega]),
    )


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ResponseCovariance:
    """Covariance of the stationary response, relative to the base.

    Parameters
    ----------
    displacement, velocity
        [m^2], [m^2/s^2].
    displacement_velocity
        Of displacement (rows) with velocity (columns) at the same instant.
    acceleration
        [m^2/s^4]; None under white force, whose power has no end.
    """

    displacement: Square
    velocity: Square
    displacement_velocity: Square
    acceleration: Square | None


def response_spectrum(
    structure: Structure,
    frequency_hz: Frequencies,
    force_psd: ForceDensity | Inexact[np.ndarray, "frequency dof dof"],
    quantity: str = "displacement",
    *,
    shaping: Shaping | None = None,
) -> Complex[np.ndarray, "frequency dof dof"]:
    r"""One-sided cross-spectral density of the response, :math:`H S H^H`.

    Parameters
    ----------
    structure
        Structure with its matrices.
    frequency_hz
        Frequencies [Hz].
    force_psd
        One-sided [N^2/Hz]: white, as one number for every translation, one for each degree of
        freedom or a matrix; or of any colour, as one matrix a frequency.
    quantity
        ``"displacement"``, ``"velocity"`` or ``"acceleration"``.
    shaping
        Colours a white `force_psd`.

    Returns
    -------
    Densities [unit of the quantity, squared, per Hz].
    """
    density = (
        np.asarray(force_psd)
        if np.ndim(force_psd) == 3
        else force_density(structure, force_psd)
    )
    response = frequency_response(structure, 2 * np.pi * frequency_hz, quantity)
    spectrum = response @ density @ response.conj().swapaxes(1, 2)
    if shaping is not None:
        spectrum = spectrum * shaping.density(frequency_hz)[:, None, None]
    return np.asarray(spectrum)


def response_covariance(
    structure: Structure, force_psd: ForceDensity, *, shaping: Shaping | None = None
) -> ResponseCovariance:
    r"""Covariance of the stationary response to white or coloured force.

    Solves Lyapunov's equation :math:`A P + P A^T + \tfrac12 B S B^T = 0`; under a coloured
    force, of the structure and its shaping filters together.

    Parameters
    ----------
    structure
        Mass, damping and stiffness matrices [kg, N s/m, N/m].
    force_psd
        One-sided density of the force [N^2/Hz]: one number, one per degree of freedom, or a
        matrix.
    shaping
        Filter that colours the force; None for white.

    Returns
    -------
    Covariances of displacement [m] and velocity [m/s].

    Raises
    ------
    ValueError
        If some motion does not die away.

    Examples
    --------
    >>> one = np.array([[1.0]])
    >>> mass = Structure(mass=one, damping=0.5 * one, stiffness=4.0 * one)
    >>> response_covariance(mass, 8.0).displacement  # S / (4 c k)
    array([[1.]])
    """
    dofs = structure.dofs
    whole, noise, acceleration = _augmented(structure, force_psd, shaping)
    if scipy.linalg.eigvals(whole).real.max() >= 0:
        raise ValueError(
            "A motion does not die away, so that the response never becomes stationary. Give "
            "every mode (and the shaping filter) damping."
        )
    covariance = scipy.linalg.solve_continuous_lyapunov(whole, -0.5 * noise @ noise.T)
    covariance = (covariance + covariance.T) / 2
    return ResponseCovariance(
        displacement=covariance[:dofs, :dofs],
        velocity=covariance[dofs : 2 * dofs, dofs : 2 * dofs],
        displacement_velocity=covariance[:dofs, dofs : 2 * dofs],
        acceleration=None if shaping is None else acceleration @ covariance @ acceleration.T,
    )


def response_correlation(
    structure: Structure,
    lags_s: Float[np.ndarray, " lag"],
    force_psd: ForceDensity,
    *,
    shaping: Shaping | None = None,
) -> Float[np.ndarray, "lag dof dof"]:
    r"""Correlation :math:`E[q(t + \tau) q(t)^T]` of the displacement, at lags of 0 or more.

    Parameters
    ----------
    structure
        Mass, damping and stiffness matrices [kg, N s/m, N/m].
    lags_s
        Lags [s].
    force_psd
        One-sided density of the force [N^2/Hz]: one number, one per degree of freedom, or a
        matrix.
    shaping
        Filter that colours the force; None for white.

    Returns
    -------
    One matrix per lag [m^2].
    """
    dofs = structure.dofs
    whole, noise, _ = _augmented(structure, force_psd, shaping)
    covariance = scipy.linalg.solve_continuous_lyapunov(whole, -0.5 * noise @ noise.T)
    moved = scipy.linalg.expm(whole * lags_s[:, None, None])
    return np.asarray((moved @ covariance)[:, :dofs, :dofs])


def growing_covariance(
    structure: Structure, times: Float[np.ndarray, " time"], force_psd: ForceDensity
) -> Float[np.ndarray, "time dof dof"]:
    r"""Covariance of the displacement under white force that starts at time zero.

    .. math:: P(t) = P_\infty - e^{A t} P_\infty e^{A^T t}

    Parameters
    ----------
    structure
        Mass, damping and stiffness matrices [kg, N s/m, N/m].
    times
        Times, ascending from 0 [s].
    force_psd
        One-sided density of the force [N^2/Hz]: one number, one per degree of freedom, or a
        matrix.

    Returns
    -------
    One matrix per time [m^2].
    """
    dofs = structure.dofs
    whole, noise, _ = _augmented(structure, force_psd, None)
    final = scipy.linalg.solve_continuous_lyapunov(whole, -0.5 * noise @ noise.T)
    moved = scipy.linalg.expm(whole * times[:, None, None])
    return np.asarray((final - moved @ final @ moved.swapaxes(1, 2))[:, :dofs, :dofs])


def _augmented(
    structure: Structure, force_psd: ForceDensity, shaping: Shaping | None
) -> tuple[
    Float[np.ndarray, "state state"],
    Float[np.ndarray, "state source"],
    Float[np.ndarray, "dof state"],
]:
    """State matrix, input of unit white noise, and what of the state is acceleration."""
    dofs = structure.dofs
    own = state_matrix(structure)
    root = density_root(force_density(structure, force_psd))
    push = scipy.linalg.solve(structure.mass, root, assume_a="pos")
    if shaping is None:
        return own, np.vstack([np.zeros_like(push), push]), own[dofs:]
    sources = np.eye(root.shape[1])
    filters = np.kron(sources, shaping.state_matrix)
    pushed = np.kron(push, shaping.output_vector[None, :])
    size = 2 * dofs + len(filters)
    whole = np.zeros((size, size))
    whole[: 2 * dofs, : 2 * dofs] = own
    whole[dofs : 2 * dofs, 2 * dofs :] = pushed
    whole[2 * dofs :, 2 * dofs :] = filters
    noise = np.zeros((size, root.shape[1]))
    noise[2 * dofs :] = np.kron(sources, shaping.input_vector[:, None])
    return whole, noise, whole[dofs : 2 * dofs]

"""Cross-periodograms of resonances under one white force, leakage included."""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

from .band import Band


def cross_periodograms(
    band: Band,
    log_frequency: Float[np.ndarray, " mode"],
    log_damping: Float[np.ndarray, " mode"],
) -> Complex[np.ndarray, "frequency mode mode"]:
    """Predict the cross-periodograms :math:`D_k` of modes among themselves; see `crossed`."""
    poles = np.stack([log_frequency, log_damping])
    return crossed(band, poles, poles)


def crossed(
    band: Band, some: Float[np.ndarray, "2 mode"], others: Float[np.ndarray, "2 other"]
) -> Complex[np.ndarray, "frequency mode other"]:
    r"""Predict the cross-periodograms of modes of unit peak under one white force.

    Of modes by ln f and ln zeta with the transfer functions :math:`h_i(s) = 2 \zeta_i \,
    (s / \omega_i)^d \, \omega_i^2 / (s^2 + 2 \zeta_i \omega_i s + \omega_i^2)` the spectra are
    :math:`h_i(s) h_j(-s)`, :math:`s = i \omega`. A record of length T puts a triangle on the
    correlations, which adds, for the pole :math:`s_i` of the residue :math:`\rho_{ij}` of the
    spectrum,

    .. math:: -\rho_{ij} \frac{1 - e^{(s_i - i \omega) T}}{T (i \omega - s_i)^2}

    and the like for :math:`s_j`: leakage, which else biases the damping of modes that are
    hardly wider than the record resolves (as in `expected_resonance`).

    Modes are given by ln f and ln zeta, in two rows.
    """
    one, other = _resonances(band, some), _resonances(band, others)
    spectra = one.transfer[:, :, None] * other.transfer[:, None, :].conj()
    leaked = one.leak[:, :, None] * _residue(one, other, band.derivatives)
    mirrored = other.leak[:, :, None] * _residue(other, one, band.derivatives)
    return np.asarray(spectra + leaked + np.swapaxes(mirrored, 1, 2).conj())


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Resonances:
    omega: np.ndarray
    damping: np.ndarray
    pole: np.ndarray
    residue: np.ndarray
    transfer: np.ndarray
    leak: np.ndarray


def _resonances(band: Band, poles: np.ndarray) -> _Resonances:
    omega, damping = 2 * np.pi * np.exp(poles[0]), np.exp(poles[1])
    s = 2j * np.pi * band.frequency_hz[:, None]
    damped = omega * np.sqrt(1 - damping**2)
    pole = -damping * omega + 1j * damped
    # At every bin exp(-s T) is 1.
    leak = -(1 - np.exp(pole * band.duration_s)) / (band.duration_s * (s - pole) ** 2)
    return _Resonances(
        omega,
        damping,
        pole,
        2 * damping * (pole / omega) ** band.derivatives * omega**2 / (2j * damped),
        _transfer(s, omega, damping, band.derivatives),
        leak,
    )


def _residue(one: _Resonances, other: _Resonances, derivatives: int) -> np.ndarray:
    """Of the cross-spectra (rows one, columns other) at the poles of the one."""
    mirrored = _transfer(-one.pole[:, None], other.omega, other.damping, derivatives)
    return np.asarray(one.residue[:, None] * mirrored)


def _transfer(
    s: np.ndarray, omega: np.ndarray, damping: np.ndarray, derivatives: int
) -> np.ndarray:
    """Of each mode (columns) at each s (rows), about 1 at its peak."""
    numerator = 2 * damping * (s / omega) ** derivatives * omega**2
    return np.asarray(numerator / (s**2 + 2 * damping * omega * s + omega**2))

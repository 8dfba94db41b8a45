"""Power of a residual that is not linearly coherent with the inputs."""

import numpy as np
import scipy.linalg
from jaxtyping import Bool, Float, Inexact

from slowtime.signals.spectra import transform

BLOCK_LINES = 24
"""[lines] Over which a transfer function is taken to be linear in frequency. Source:
docs/what_decides.md: half and double change no answer."""
MIN_FREE_SHARE = 0.1
"""[share of power] That a regression has to leave for its residual to be used: spectra of few
samples are taken as they are. Source: docs/what_decides.md: half and double change no
answer."""


def incoherent_power(
    residual: Float[np.ndarray, "time sensor"],
    inputs: Float[np.ndarray, "time input"],
    rate_hz: float,
    used: Bool[np.ndarray, "time sensor"],
) -> tuple[
    Float[np.ndarray, " frequency"],
    Float[np.ndarray, "frequency sensor"],
    Float[np.ndarray, " sensor"],
]:
    r"""Density of a residual after local linear regression on the inputs.

    In every block of lines, :math:`R_k = (a + b k) U_k + c + d k + N_k` by least squares: the
    last two terms are the transient of a record that does not begin and end at rest. The rest
    is scaled by the degrees of freedom left. Linear misfit, such as a wrong hold of the input
    between samples, is thereby removed.

    Lines of noise with gaps are correlated, :math:`E[N_k N_l^*] \propto M_{k-l}` with
    the transform :math:`M` of the mask: with few samples, close together, the regression
    removes more power.

    Parameters
    ----------
    inputs
        Inputs (time, input); constant ones are left out.

    Returns
    -------
    frequency
        [Hz], without the first line.
    density
        One-sided [unit²/Hz] (frequency, sensor).
    share
        Of the lines that are still independent, of each sensor.

    References
    ----------
    .. [1] R. Pintelon, J. Schoukens, "System Identification: A Frequency Domain Approach",
       2nd ed., Wiley (2012), ch. 7 (local polynomial method, here of first order).
    """
    frequency, spectrum = transform(residual, rate_hz)
    inputs = inputs[:, np.ptp(inputs, axis=0) > 0]
    moved = transform(inputs, rate_hz)[1] if inputs.shape[1] else np.empty((len(frequency), 0))
    blocks = (len(frequency) - 2) // BLOCK_LINES
    kept = slice(1, 1 + blocks * BLOCK_LINES)
    ramp = np.linspace(-1.0, 1.0, BLOCK_LINES)[:, None]
    pushed = moved[kept].reshape(blocks, BLOCK_LINES, -1)
    scale = np.sqrt(np.mean(np.abs(pushed) ** 2, axis=1, keepdims=True)) + np.finfo(float).tiny
    pushed = pushed / scale
    smooth = np.broadcast_to(np.concatenate([ramp**0, ramp], axis=1), (blocks, BLOCK_LINES, 2))
    basis, _ = np.linalg.qr(np.concatenate([smooth, pushed, ramp * pushed], axis=2))
    lines = spectrum[kept].reshape(blocks, BLOCK_LINES, -1)
    left = lines - basis @ (basis.conj().swapaxes(1, 2) @ lines)
    power = np.abs(left) ** 2
    spare = np.full(power.shape[2], 1 - basis.shape[2] / BLOCK_LINES)
    power /= spare
    for sensor in np.flatnonzero(~used.all(axis=0)).tolist():
        own = _free_share(basis, used[:, sensor])
        if own.mean() < MIN_FREE_SHARE:
            power[:, :, sensor], spare[sensor] = np.abs(lines[:, :, sensor]) ** 2, 1.0
        else:
            power[:, :, sensor] *= spare[sensor] / np.maximum(own, MIN_FREE_SHARE)[:, None]
            spare[sensor] = own.mean()
    return frequency[kept], power.reshape(blocks * BLOCK_LINES, -1), spare


def _free_share(
    basis: Inexact[np.ndarray, "block line column"], use: Bool[np.ndarray, " time"]
) -> Float[np.ndarray, " block"]:
    """Share of the power of white noise with gaps that the regression in each block leaves."""
    mask = np.fft.fft(use.astype(float))[:BLOCK_LINES] / max(use.sum(), 1)
    alike = scipy.linalg.toeplitz(mask, mask.conj())
    taken = np.einsum("bic,ij,bjc->b", basis.conj(), alike, basis, optimize=True).real
    return np.asarray(1 - taken / BLOCK_LINES)

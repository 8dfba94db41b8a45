"""What of a residual no smooth transfer from the inputs explains, line by line."""

import numpy as np
from jaxtyping import Float

from slowtime.signals.spectra import transform

BLOCK = 24
"""Lines over which a transfer function is taken for a straight line."""


def incoherent_power(
    residual: Float[np.ndarray, "time sensor"],
    inputs: Float[np.ndarray, "time input"],
    rate_hz: float,
) -> tuple[Float[np.ndarray, " frequency"], Float[np.ndarray, "frequency sensor"], float]:
    r"""Density of a residual less its local linear regression on the inputs.

    In every block of lines, :math:`R_k = (a + b k) U_k + c + d k + N_k` by least squares: the
    last two terms are the transient of a record that begins and ends anywhere. What is left is
    scaled by the degrees of freedom used up. Linear misfit, such as an input held otherwise
    between its samples than the model says, is no noise, and goes.

    Returns
    -------
    Frequencies [Hz], without the first line; density [unit²/Hz]; share of the lines that are
    still independent.

    References
    ----------
    .. [1] R. Pintelon, J. Schoukens, "System Identification: A Frequency Domain Approach",
       2nd ed., Wiley (2012), ch. 7 (local polynomial method, here of first order).
    """
    frequency, spectrum = transform(residual, rate_hz)
    moved = transform(inputs, rate_hz)[1] if inputs.shape[1] else np.empty((len(frequency), 0))
    blocks = (len(frequency) - 2) // BLOCK
    kept = slice(1, 1 + blocks * BLOCK)
    ramp = np.linspace(-1.0, 1.0, BLOCK)[:, None]
    pushed = moved[kept].reshape(blocks, BLOCK, -1)
    scale = np.sqrt(np.mean(np.abs(pushed) ** 2, axis=1, keepdims=True)) + np.finfo(float).tiny
    pushed = pushed / scale
    smooth = np.broadcast_to(np.concatenate([ramp**0, ramp], axis=1), (blocks, BLOCK, 2))
    basis, _ = np.linalg.qr(np.concatenate([smooth, pushed, ramp * pushed], axis=2))
    lines = spectrum[kept].reshape(blocks, BLOCK, -1)
    left = lines - basis @ (basis.conj().swapaxes(1, 2) @ lines)
    spare = 1 - basis.shape[2] / BLOCK
    power = (np.abs(left) ** 2 / spare).reshape(blocks * BLOCK, -1)
    return frequency[kept], power, spare

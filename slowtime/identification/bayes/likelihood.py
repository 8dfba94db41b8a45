r"""Coefficients and parameters in; log-posterior, its slope and its information out.

.. math:: \ln p = -\sum_k (n_k \ln \det E_k + \mathrm{tr}\, E_k^{-1} \Sigma_k) + \mathrm{prior},
          \qquad I_{ab} = \sum_k n_k \, \mathrm{tr}\, E_k^{-1} E_{k,a} E_k^{-1} E_{k,b}

The products are worked out by hand, for all changes of E have rank m or 1: with
:math:`W = E^{-1}`, :math:`V = W \Psi`, :math:`Q = \Psi^T V`, :math:`H` the spectral matrix of
the modes and :math:`t = V H`, no sum is dearer than channels × modes squared.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from .model import Band, Modes, cross_periodograms, modes_of, spectral_slopes, vector_of

NOISE_PRIOR_SD = 3.0
"""Of ln noise about where it started: keeps a noise that nothing shows from running away."""

MIXING_PRIOR_SD = 1.0
"""Of the parts of L about where they started: any coherence may be, of rows about 1."""


def log_posterior(band: Band, vector: Float[np.ndarray, " parameter"], start: Modes) -> float:
    """Log-posterior up to a constant; the priors are about `start`."""
    modes = modes_of(vector, start)
    crossed = cross_periodograms(band, modes.log_frequency, modes.log_damping)
    matrices = _matrices(band, modes, crossed * modes.coherence)
    sign, logarithm = np.linalg.slogdet(matrices)
    if not (np.isfinite(logarithm).all() and (sign.real > 0).all()):
        return -np.inf
    misfit = np.einsum("kcd,kdc->", np.linalg.inv(matrices), band.scatter).real
    middle, weight = _prior(start)
    prior = 0.5 * np.sum(weight * (vector - middle) ** 2)
    return float(-np.sum(band.number * logarithm) - misfit - prior)


def slope(
    band: Band, vector: Float[np.ndarray, " parameter"], start: Modes
) -> Float[np.ndarray, " parameter"]:
    """Gradient of the log-posterior."""
    middle, weight = _prior(start)
    uphill = _slope(band, _worked_out(band, vector, start)) - weight * (vector - middle)
    return np.asarray(uphill)


def slope_and_information(
    band: Band, vector: Float[np.ndarray, " parameter"], start: Modes
) -> tuple[Float[np.ndarray, " parameter"], Float[np.ndarray, "parameter parameter"]]:
    """Gradient of the log-posterior, and Fisher information plus that of the prior."""
    parts = _worked_out(band, vector, start)
    middle, weight = _prior(start)
    uphill = _slope(band, parts) - weight * (vector - middle)
    return uphill, _information(band, parts) + np.diag(weight)


def _prior(start: Modes) -> tuple[np.ndarray, np.ndarray]:
    """Middle and information of the prior, parameter by parameter."""
    middle = vector_of(start)
    weight = np.zeros_like(middle)
    mixed = slice(2 * start.number, 2 * start.number + len(start.free_mixing))
    weight[mixed] = MIXING_PRIOR_SD**-2
    weight[-len(start.log_noise) :] = NOISE_PRIOR_SD**-2
    return middle, weight


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Parts:
    """The matrices of the module's opening, each with the bins first; x are slopes of h.

    Of t, q h and h q h only what belongs to modes of the band is kept.
    """

    modes: Modes
    h: np.ndarray
    x: np.ndarray
    w: np.ndarray
    v: np.ndarray
    q: np.ndarray
    t: np.ndarray
    qh: np.ndarray
    r: np.ndarray
    level: np.ndarray


def _worked_out(band: Band, vector: np.ndarray, start: Modes) -> _Parts:
    modes = modes_of(vector, start)
    h, x = spectral_slopes(band, modes)
    w = np.linalg.inv(_matrices(band, modes, h))
    v = w @ modes.shapes
    q = modes.shapes.T @ v
    own = h[:, :, modes.guests :]
    qh = q @ own
    r = np.swapaxes(own, 1, 2).conj() @ qh
    return _Parts(modes, h, x, w, v, q, v @ own, qh, r, np.exp(modes.log_noise))


def _matrices(band: Band, modes: Modes, h: np.ndarray) -> np.ndarray:
    rung = modes.shapes @ h @ modes.shapes.T + np.diag(np.exp(modes.log_noise))
    return np.asarray(rung if band.background is None else rung + band.background)


def _slope(band: Band, parts: _Parts) -> np.ndarray:
    modes, w = parts.modes, parts.w
    excess = w @ band.scatter @ w - band.number[:, None, None] * w
    heard = excess @ modes.shapes
    of_modes = np.einsum("pkij,kji->p", parts.x, modes.shapes.T @ heard).real
    of_shapes = 2 * np.sum(heard @ parts.h[:, :, modes.guests :], axis=0).T.real
    of_noise = parts.level * np.einsum("kcc->c", excess).real
    return np.concatenate([of_modes, of_shapes.ravel(), of_noise])


def _information(band: Band, parts: _Parts) -> np.ndarray:
    w, v, t, level = parts.w, parts.v, parts.t, parts.level
    weight = band.number[:, None, None]
    qx = parts.q @ parts.x
    parameters, bins = parts.x.shape[:2]
    flat = (weight * qx).reshape(parameters, -1)
    turned = np.swapaxes(qx, 2, 3).reshape(parameters, -1)
    modes_modes = (flat @ turned.T).real
    vx = weight * (v @ parts.x)
    modes_shapes = 2 * np.sum(vx @ parts.qh, axis=1).real
    modes_shapes = np.swapaxes(modes_shapes, 1, 2).reshape(parameters, -1)
    modes_noise = level * np.einsum("pkci,kci->pc", vx, v.conj()).real
    channels, number = t.shape[1:]
    size = channels * number
    long_t = np.swapaxes(t, 1, 2).reshape(bins, size)
    crossing = (long_t.T @ (band.number[:, None] * long_t)).reshape(
        number, channels, number, channels
    )
    crossing = np.transpose(crossing, (2, 1, 0, 3))  # t_jc t_id at [i, c, j, d]
    r = (weight * parts.r).reshape(bins, -1)
    waiting = (r.T @ w.reshape(bins, -1)).reshape(number, number, channels, channels)
    crossing = crossing + np.transpose(waiting, (0, 3, 1, 2))  # r_ij w_dc
    shapes_shapes = 2 * crossing.real.reshape(size, size)
    shapes_noise = 2 * np.einsum("kdc,kdi->icd", weight * w, t.conj()).real * level
    noise_noise = np.sum(weight * np.abs(w) ** 2, axis=0) * np.outer(level, level)
    flat_noise = shapes_noise.reshape(size, -1)
    return np.block(
        [
            [modes_modes, modes_shapes, modes_noise],
            [modes_shapes.T, shapes_shapes, flat_noise],
            [modes_noise.T, flat_noise.T, noise_noise],
        ]
    )

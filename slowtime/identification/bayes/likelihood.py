r"""Log-posterior of the modes of one band, with gradient and Fisher information.

.. math:: \ln p = -\sum_k (n_k \ln \det E_k + \mathrm{tr}\, E_k^{-1} \Sigma_k) + \mathrm{prior},
          \qquad I_{ab} = \sum_k n_k \, \mathrm{tr}\, E_k^{-1} E_{k,a} E_k^{-1} E_{k,b}

Every change of E has rank two, :math:`E_{,1} = a_1 b_1^H + b_1 a_1^H`, so that, of
:math:`W = E^{-1}`,

.. math:: \mathrm{tr}\, W E_{,1} W E_{,2} =
          2\, \mathrm{Re}\, (b_1^H W a_2 \; b_2^H W a_1 + b_1^H W b_2 \; a_2^H W a_1)

Of pole and coherence of mode i, a is its shape and :math:`b^H` what row i of the spectral
matrix H changes by, times :math:`\Psi^T`; of a shape, a is the channel and b a column of
:math:`\Psi H`. Hence :math:`V = W \Psi` and :math:`Q = \Psi^T V` below.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from .band import Band
from .model import (
    BandModes,
    modes_from_vector,
    noise_density,
    parameter_vector,
    slope_order,
    spectral_slopes,
)
from .resonances import cross_periodograms

NOISE_PRIOR_SD = 3.0
"""Prior standard deviation of ln noise about its initial value: keeps a noise that the data do
not determine bounded."""

NOISE_EXPONENT_SD = 4.0
"""Prior standard deviation of the exponent of the noise over frequency [1]: noise that is white
in displacements has 4 in accelerations, a drift -2."""

OWN_FORCES = 0.5
r"""Exponent :math:`\eta` of the prior :math:`\det(G)^\eta` of coherences: little, but enough
that forces which are nearly one do not make a singular top."""


def log_posterior(
    band: Band, vector: Float[np.ndarray, " parameter"], start: BandModes
) -> float:
    """Log-posterior up to a constant; the priors are about `start`."""
    modes = modes_from_vector(vector, start)
    crossed = cross_periodograms(band, modes.log_frequency, modes.log_damping)
    matrices = _matrices(band, modes, crossed * modes.coherence)
    sign, logarithm = np.linalg.slogdet(matrices)
    if not (np.isfinite(logarithm).all() and (sign.real > 0).all()):
        return -np.inf
    misfit = np.einsum("kcd,kdc->", np.linalg.inv(matrices), band.scatter).real
    return float(log_prior(modes, start) - np.sum(band.number * logarithm) - misfit)


def gradient(
    band: Band, vector: Float[np.ndarray, " parameter"], start: BandModes
) -> Float[np.ndarray, " parameter"]:
    """Gradient of the log-posterior."""
    parts = _worked_out(band, vector, start)
    return np.asarray(_slope(band, parts) + _prior(parts.modes, start)[0])


def gradient_and_information(
    band: Band, vector: Float[np.ndarray, " parameter"], start: BandModes
) -> tuple[Float[np.ndarray, " parameter"], Float[np.ndarray, "parameter parameter"]]:
    """Gradient of the log-posterior, and Fisher information plus that of the prior."""
    parts = _worked_out(band, vector, start)
    uphill, information = _prior(parts.modes, start)
    return _slope(band, parts) + uphill, _information(band, parts) + information


def log_prior(modes: BandModes, start: BandModes) -> float:
    """Log-prior of coherences and noise; keeps the length of the rows near 1."""
    own = np.arange(modes.guests, len(modes.log_frequency))
    length = np.linalg.norm(modes.mixing[own], axis=1)
    itself = modes.mixing[own, own].real
    if not (itself > 0).all():
        return -np.inf
    noise = (modes.log_noise - start.log_noise) / NOISE_PRIOR_SD
    coherent = 2 * OWN_FORCES * np.log(itself / length)
    exponent = modes.noise_exponent / NOISE_EXPONENT_SD
    squares = np.sum((length - 1) ** 2) + np.sum(noise**2) + np.sum(exponent**2)
    return float(coherent.sum() - 0.5 * squares)


def coherence_score(band: Band, start: BandModes) -> tuple[float, int]:
    r"""Rao's score statistic of coherences that are zero in `start`.

    Slope and information are what is left when the other parameters are free to give way. Gives
    the statistic and its degrees of freedom; forces are independent in `start`.
    """
    parts = _worked_out(band, parameter_vector(start), start)
    uphill, information = _slope(band, parts), _information(band, parts)
    places = [k for k, (row, column, _) in enumerate(start.free_mixing) if row > column]
    asked = np.zeros(len(uphill), dtype=bool)
    asked[2 * start.number + np.array(places, dtype=int)] = True
    told = ~asked & (np.diag(information) > 0)
    among, across = information[np.ix_(told, told)], information[np.ix_(told, asked)]
    gain = np.linalg.lstsq(among, across)[0]
    values, vectors = np.linalg.eigh(information[np.ix_(asked, asked)] - across.T @ gain)
    scores = vectors.T @ (uphill[asked] - gain.T @ uphill[told])
    # Only directions in which the record would know a coherence to better than 1.
    known = values > 1.0
    return float(np.sum(scores[known] ** 2 / values[known])), int(known.sum())


def _prior(modes: BandModes, start: BandModes) -> tuple[np.ndarray, np.ndarray]:
    """Gradient of the log-prior and, as information, what of its curvature is positive."""
    vector, free = parameter_vector(modes), modes.free_mixing
    uphill, information = np.zeros_like(vector), np.zeros((len(vector), len(vector)))
    for row in sorted({row for row, _, _ in free}):
        places = 2 * modes.number + np.array([k for k, f in enumerate(free) if f[0] == row])
        itself = 2 * modes.number + free.index((row, row, 1.0))
        part, length = vector[places], np.linalg.norm(modes.mixing[row])
        outward = part / length
        uphill[places] -= 2 * OWN_FORCES / length * outward + (length - 1) * outward
        uphill[itself] += 2 * OWN_FORCES / vector[itself]
        along = np.outer(outward, outward)
        across = 2 * OWN_FORCES / length**2 * (np.eye(len(part)) - along)
        information[np.ix_(places, places)] = along + across
        information[itself, itself] += 2 * OWN_FORCES / vector[itself] ** 2
    channels = len(modes.log_noise)
    noise, last = slice(-2 * channels, None), np.arange(len(vector))[-2 * channels :]
    stiff = np.repeat([NOISE_PRIOR_SD**-2, NOISE_EXPONENT_SD**-2], channels)
    away = [modes.log_noise - start.log_noise, modes.noise_exponent]
    uphill[noise] = -stiff * np.concatenate(away)
    information[last, last] = stiff
    return uphill, information


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Parts:
    """The matrices of the module's opening, each with the bins first.

    Of h, t and r (those of H, V H and H Q H) only what belongs to modes of the band is kept.
    The rows y of all their modes stand one after the other; `of` says whose each is. `noise`
    holds the slopes of the noise of each channel by its logarithm, then by its exponent.
    """

    modes: BandModes
    y: np.ndarray
    of: np.ndarray
    h: np.ndarray
    w: np.ndarray
    v: np.ndarray
    q: np.ndarray
    noise: np.ndarray


def _worked_out(band: Band, vector: np.ndarray, start: BandModes) -> _Parts:
    modes = modes_from_vector(vector, start)
    h, rows = spectral_slopes(band, modes)
    w = np.linalg.inv(_matrices(band, modes, h))
    v = w @ modes.shapes
    own = np.arange(modes.guests, modes.guests + modes.number)
    of = np.repeat(own, [each.shape[1] for each in rows])
    y, q = np.concatenate(rows, axis=1), modes.shapes.T @ v
    level, away = noise_density(band, modes)
    noise = np.concatenate([level, away[:, None] * level], axis=1)
    return _Parts(modes, y, of, h[:, :, own], w, v, q, noise)


def _matrices(band: Band, modes: BandModes, h: np.ndarray) -> np.ndarray:
    rung = modes.shapes @ h @ modes.shapes.T
    channel = np.arange(len(modes.log_noise))
    rung[:, channel, channel] += noise_density(band, modes)[0]
    return np.asarray(rung if band.background is None else rung + band.background)


def _slope(band: Band, parts: _Parts) -> np.ndarray:
    modes, w = parts.modes, parts.w
    excess = w @ band.scatter @ w - band.number[:, None, None] * w
    heard = excess @ modes.shapes
    seen = modes.shapes.T @ heard
    of_rows = 2 * np.einsum("kpm,kmp->p", parts.y, seen[:, :, parts.of]).real
    of_modes = np.empty_like(of_rows)
    of_modes[slope_order(modes)] = of_rows
    of_shapes = 2 * np.einsum("kcm,kmi->ic", heard, parts.h).real
    itself = np.einsum("kcc->kc", excess).real
    of_noise = np.sum(parts.noise * np.concatenate([itself, itself], axis=1), axis=0)
    return np.concatenate([of_modes, of_shapes.ravel(), of_noise])


def _information(band: Band, parts: _Parts) -> np.ndarray:
    """Blocks by poles and coherences, by shapes (mode after mode), by noises and exponents."""
    w, v, h, noise = parts.w, parts.v, parts.h, parts.noise
    twice = np.tile(np.arange(w.shape[1]), 2)
    weight = band.number[:, None, None]
    rows = weight * (parts.y @ np.swapaxes(v, 1, 2).conj())
    of_a = v[:, :, parts.of]
    turned = np.swapaxes(h, 1, 2).conj() @ parts.q[:, :, parts.of]
    # Products of matrices, one a row of y: sums over bins of three indices do not use BLAS.
    modes_shapes = np.transpose(turned, (2, 1, 0)) @ np.swapaxes(rows, 0, 1)
    crossing = weight * (parts.y @ parts.q @ h)
    modes_shapes += np.transpose(crossing, (1, 2, 0)) @ np.transpose(of_a, (2, 0, 1))
    modes_noise = np.einsum("kpc,kcp,kc->pc", rows[:, :, twice], of_a[:, twice], noise)
    shapes_shapes = _among_shapes(
        band.number, v @ h, w, np.swapaxes(h, 1, 2).conj() @ parts.q @ h
    )
    by_noise = (weight * w)[:, twice] * noise[:, :, None]
    shapes_noise = np.einsum("kdc,kdi->icd", by_noise, (v @ h).conj()[:, twice])
    both = (by_noise * w.conj()[:, twice])[:, :, twice] * noise[:, None]
    noise_noise = np.sum(both.real, axis=0)
    count = len(parts.of)
    ordered = np.argsort(slope_order(parts.modes))
    upper = 2 * modes_shapes.real.reshape(count, -1)[ordered]
    right = 2 * modes_noise.real[ordered]
    below = 2 * shapes_noise.real.reshape(-1, len(twice))
    return np.block(
        [
            [_among_rows(band.number, parts)[np.ix_(ordered, ordered)], upper, right],
            [upper.T, shapes_shapes, below],
            [right.T, below.T, noise_noise],
        ]
    )


def _among_rows(number: np.ndarray, parts: _Parts) -> np.ndarray:
    """Of poles and coherences, in the order of the rows y."""
    y, q, of = parts.y, parts.q, parts.of
    yq = y @ q
    whole = np.zeros((len(of), len(of)))
    for i in np.unique(of):
        for j in np.unique(of):
            one, two = of == i, of == j
            swapped = yq[:, one, j].T @ (number[:, None] * yq[:, two, i])
            weighted = (number * q[:, j, i])[:, None, None] * yq[:, one]
            flat = [np.swapaxes(a, 0, 1).reshape(a.shape[1], -1) for a in (weighted, y[:, two])]
            whole[np.ix_(one, two)] = 2 * (swapped + flat[0] @ flat[1].conj().T).real
    return whole


def _among_shapes(
    number: np.ndarray, t: np.ndarray, w: np.ndarray, r: np.ndarray
) -> np.ndarray:
    """Of shapes, mode after mode; r is H Q H."""
    bins, channels, modes = t.shape
    size = channels * modes
    long = np.swapaxes(t, 1, 2).reshape(bins, size)
    crossing = (long.T @ (number[:, None] * long)).reshape(modes, channels, modes, channels)
    waiting = (number[:, None] * r.reshape(bins, -1)).T @ w.reshape(bins, -1)
    waiting = waiting.reshape(modes, modes, channels, channels)
    # t_jc t_id, and r_ij w_dc, at [i, c, j, d].
    both = np.transpose(crossing, (2, 1, 0, 3)) + np.transpose(waiting, (0, 3, 1, 2))
    return np.asarray(2 * both.real.reshape(size, size))

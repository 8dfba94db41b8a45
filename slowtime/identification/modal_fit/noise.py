r"""Noise of spectra: smoothed over lines, or modelled from what a fit left over.

Unmeasured excitation shakes the modes, so that the noise has peaks as narrow as those of the
response, and is common to all outputs there. With powers b, not negative,

.. math:: S_{nn,e}(\omega) = \sum_j b_{ej} \, t_j(\omega) + \sum_k b_{ek} \,
          \frac{(\mathrm{Re} \lambda_k)^2}{|j \omega - \lambda_k|^2}

is the power of the noise of an entry: triangular functions t over a coarse grid, and a peak at
each pole, once with its flanks and once with flanks that end (between modes and beyond them
the noise is not that of one mode). It is fitted to the squared residuals by iterated weighted
least squares, which is maximum likelihood for their exponential distribution.
"""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float
from scipy.optimize import nnls

KNOTS = 10
"""Triangular functions over the band, at most [1]."""

ROWS_PER_KNOT = 30
"""Rows for each of them, at least [1]."""

FLANKS = 6.0
"""[half-bandwidths] From a pole at which the flanks of the second kind of peak have halved: the
peak itself is still as it should be, and neighbouring modes are beyond."""

ITERATIONS = 8
"""Weighted fits of the noise [1]; changes are then below a percent."""

LEAST = 1e-9
"""Least noise relative to the largest value of an entry [1]: rounding."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoiseModel:
    """Noise of each row and entry, and the part of it that entries have in common.

    Parameters
    ----------
    common
        Amplitude of the noise that shakes each mode; its products over entries are the
        covariance of their noise.
    """

    sd: Float[np.ndarray, "row entry"]
    common: Complex[np.ndarray, "row entry mode"]


def model_noise(
    s: Complex[np.ndarray, " row"],
    residuals: Complex[np.ndarray, "row entry"],
    leverage: Float[np.ndarray, "row entry"],
    poles: Complex[np.ndarray, " mode"],
    shapes: Complex[np.ndarray, "entry mode"],
) -> NoiseModel:
    """Noise of each row and entry by the residuals of a fit.

    Rows are in order of frequency. `leverage` is the expected loss of their power by the fit;
    shapes give the signs of common noise.
    """
    away = np.abs(s.imag[:, None] - poles.imag) / np.abs(poles.real)
    peaks = 1.0 / (1.0 + away**2)
    narrow = peaks / (1.0 + (away / FLANKS) ** 2)
    basis = np.concatenate([_triangles(len(s)), peaks, narrow], axis=1)
    power = np.abs(residuals) ** 2 / (1.0 - leverage)
    sizes = np.abs(shapes)
    phases = shapes / np.where(sizes > 0, sizes, 1.0)
    sd = np.empty(power.shape)
    common = np.zeros((*power.shape, len(poles)), dtype=complex)
    for entry in range(power.shape[1]):
        found = _fitted(basis, power[:, entry])
        floor = LEAST**2 * np.max(power[:, entry]) + np.finfo(float).tiny
        sd[:, entry] = np.sqrt(basis @ found + floor)
        wide, near = found[-2 * len(poles) :].reshape(2, -1)
        of_modes = np.sqrt(wide * peaks + near * narrow)
        common[:, entry] = of_modes * phases[entry]
    return NoiseModel(sd=sd, common=common)


def _triangles(rows: int) -> np.ndarray:
    """Triangular functions of the number of the row, which add up to 1."""
    knots = max(2, min(KNOTS, rows // ROWS_PER_KNOT))
    place = np.linspace(0.0, knots - 1.0, rows)
    return np.asarray(np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(knots))))


def _fitted(basis: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Powers that are not negative, of greatest likelihood."""
    size = float(np.mean(power)) + np.finfo(float).tiny
    expected = np.ones(len(power))
    found = np.ones(basis.shape[1])
    for _ in range(ITERATIONS):
        found, _ = nnls(basis / expected[:, None], power / size / expected)
        expected = np.maximum(basis @ found, 1e-6)
    return np.asarray(found * size)

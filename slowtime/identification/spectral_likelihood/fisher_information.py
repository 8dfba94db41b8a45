"""Fisher information and score of the spectral likelihood of a band.

Matrices are whitened by the inverse root of the density and packed as real vectors, so that
information is the product of rows, and the score that of rows and misfit.
"""

import functools
import math

import numpy as np

from .model import BandData, BandModel

GAUGE = 1e-9
"""Eigenvalues of the information below this share of the largest count as zero [1]."""


def fisher_information(
    data: BandData, model: BandModel, density: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Fisher information and score of all parameters.

    Parameters
    ----------
    data
        Mean spectral matrices of the band.
    model
        Modal state-space model of the band.
    density
        Density that the model predicts.

    Returns
    -------
    Information matrix, and score.
    """
    root = whitener(data, density)
    rows = density_derivatives(model, data, root)
    return add_prior(model, rows @ rows.T, rows @ misfit(data, density, root))


def add_prior(
    model: BandModel, information: np.ndarray, score: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Add prior information and score of the poles.

    Parameters
    ----------
    model
        Modal state-space model of the band.
    information
        Information matrix.
    score
        Score.

    Returns
    -------
    Information and score with prior.
    """
    modes = 0 if model.still else len(model.pole) - model.held
    away, wide = (each[:, :modes].T.reshape(-1) for each in model.ties())
    own = np.arange(2 * modes)
    information[own, own] += wide**-2
    score[own] -= away / wide**2
    return information, score


def whitener(data: BandData, density: np.ndarray) -> np.ndarray:
    """Inverse roots of the density, weighted by the number of ordinates.

    Parameters
    ----------
    data
        Mean spectral matrices of the band.
    density
        Density that the model predicts.

    Returns
    -------
    One matrix per group.
    """
    weight = data.number[:, None, None] ** 0.25
    return np.asarray(np.linalg.inv(np.linalg.cholesky(density)) * weight)


def misfit(data: BandData, density: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Difference of data and model densities, whitened and packed.

    Parameters
    ----------
    data
        Mean spectral matrices of the band.
    density
        Density that the model predicts.
    root
        Whitening matrices.

    Returns
    -------
    Real vector.
    """
    left = root @ (data.density - density) @ root.conj().transpose(0, 2, 1)
    row, column = _triangle(left.shape[-1])
    packed = np.empty((len(left), left.shape[-1] ** 2))
    _pack(left[:, row, column], packed)
    return packed.reshape(-1)


def density_derivatives(model: BandModel, data: BandData, root: np.ndarray) -> np.ndarray:
    """Differentiate the density by the free parameters; whitened and packed.

    All derivatives are outer products, so that vectors are whitened rather than matrices.

    Parameters
    ----------
    model
        Modal state-space model of the band.
    data
        Mean spectral matrices of the band.
    root
        Whitening matrices.

    Returns
    -------
    One row per parameter.
    """
    directions, free, omega = len(model.shape), len(model.pole) - model.held, data.omega
    gain, bent = (each[:, :, None] for each in model.gain(omega, data.width))
    unit = root.transpose(2, 0, 1)
    plain = (root @ model.shape).transpose(2, 0, 1)
    shape = gain * plain
    force = (root @ model.force).transpose(2, 0, 1)
    heard = gain.conj() * force
    moving = 0 if model.still else free
    of_poles = outer_product_rows(bent[:moving] * plain[:moving], force[:moving])
    of_poles[::2] *= model.pole[:moving].real[:, None]
    of_shapes = outer_product_rows(unit, heard[:free, None])
    of_forces = outer_product_rows(shape[:, None], unit)
    of_forces[1::2] *= -1.0
    level = _hermitian_pairs(unit)
    slope = level.reshape(directions**2, len(omega), -1) * omega[:, None]
    return np.concatenate([of_poles, of_shapes, of_forces, level, slope.reshape(level.shape)])


def outer_product_rows(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Outer products of vectors plus their adjoints, and the same of i times the first.

    Packed, ["2 * pair", "group * direction ** 2"].

    Parameters
    ----------
    one, other
        Vectors of each group.

    Returns
    -------
    Two rows per pair: the sum, and i times the difference.
    """
    directions = one.shape[-1]
    row, column = _triangle(directions)
    forth = one[..., row] * other.conj()[..., column]
    back = other[..., row] * one.conj()[..., column]
    packed = np.empty((*forth.shape[:-2], 2, forth.shape[-2], directions**2))
    _pack(forth + back, packed[..., 0, :, :])
    _pack(1j * (forth - back), packed[..., 1, :, :])
    return packed.reshape(-1, forth.shape[-2] * directions**2)


def _hermitian_pairs(unit: np.ndarray) -> np.ndarray:
    """Whitened matrices of the basis of Hermitian ones, packed."""
    directions = len(unit)
    low, high = np.tril_indices(directions)
    both = outer_product_rows(unit[low], unit[high])
    own = 2 * np.flatnonzero(low == high)
    both[own] *= 0.5
    return np.delete(both, own + 1, axis=0)


def _pack(upper: np.ndarray, packed: np.ndarray) -> None:
    """Upper triangles of Hermitian matrices as real vectors with the same inner products."""
    directions = math.isqrt(packed.shape[-1])
    packed[..., :directions] = upper.real[..., :directions]
    size = math.sqrt(2.0)
    middle = upper.shape[-1]
    packed[..., directions:middle] = size * upper.real[..., directions:]
    packed[..., middle:] = size * upper.imag[..., directions:]


@functools.cache
def _triangle(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the diagonal, then of what is above it."""
    own, (row, column) = np.arange(size), np.triu_indices(size, 1)
    return np.concatenate([own, row]), np.concatenate([own, column])


def restricted_inverse(information: np.ndarray) -> np.ndarray:
    """Inverse of an information matrix on the parameters that the data determine.

    Parameters
    ----------
    information
        Information matrix.

    Returns
    -------
    Covariance; zero along length and phase of the shapes.
    """
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    power, directions = np.linalg.eigh(information / scale[:, None] / scale)
    keep = power > GAUGE * power[-1]
    inverse = (directions[:, keep] / power[keep]) @ directions[:, keep].T
    return np.asarray(inverse / scale[:, None] / scale)

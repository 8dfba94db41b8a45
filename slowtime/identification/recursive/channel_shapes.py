r"""Mode shapes over all channels from a model of a few combinations of channels.

Given poles, shapes :math:`\phi_m` and forces :math:`g_m` of the combinations m, the densities
of a channel c with them are linear in what is not known of the channel,

.. math:: S_{cm}(\omega) = \sum_j \left( \frac{\phi_{cj} \bar g_{mj}}{i \omega - s_j} +
          \frac{g_{cj} \bar \phi_{mj}}{-i \omega - \bar s_j} \right) + R_{cm} + R'_{cm} \omega ,

and scatter in proportion to what of the channel the combinations do not explain.
"""

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification.spectral_likelihood.likelihood import BandFit
from slowtime.identification.spectral_likelihood.model import BandModel

from .window_data import FEWEST_ORDINATES, FadingSpectra, FadingWindow

REACH = 12.0
"""Range about a mode from which its shape is estimated [half-bandwidths]."""

LEAST = 1e-4
"""Least density of the model, relative to its median [1]."""

ShapeWithErrors = tuple[Complex[np.ndarray, " channel"], Float[np.ndarray, " channel"]]


def expand_to_channels(
    seen: FadingSpectra, case: FadingWindow, best: BandFit
) -> list[ShapeWithErrors]:
    """Shape over all channels, with standard deviations, of each mode."""
    model = best.model
    omega = (2 * np.pi * seen.frequency_hz[case.inside] - case.middle) / case.unit
    turned = case.directions.conj().T @ seen.density[case.inside] @ case.directions
    cross = seen.cross[case.inside] @ case.directions
    power = seen.power[case.inside]
    white = _inverse_root(model.density(omega))
    columns = (_columns(model, omega) @ white).transpose(0, 2, 1)
    shown = []
    for k, pole in enumerate(model.pole[: len(model.pole) - model.held]):
        away = np.abs(1j * omega - pole)
        # Far away the skirts of others, which the model does not hold, tell more than its own.
        about = away < max(REACH * -pole.real, np.sort(away)[FEWEST_ORDINATES - 1])
        near = np.where(about, away**-2.0, 0.0)
        regression, unexplained = _explained(turned, cross, power, near / near.sum())
        inverse = np.linalg.pinv(columns[about].reshape(-1, columns.shape[2]))[k]
        # The combinations' own scatter is no error of what a channel has beyond them.
        beyond = ((cross - regression @ turned) @ white)[about].transpose(0, 2, 1)
        more = inverse @ beyond.reshape(len(inverse), -1)
        own = np.sum(np.abs(inverse) ** 2) * unexplained / seen.number
        shape = regression @ model.shape[:, k] + more
        shown.append(_shown(shape, regression, best.shape_covariance(k), own))
    return shown


def _inverse_root(density: np.ndarray) -> np.ndarray:
    """Hermitian; between the groups that were fitted a model need not be quite positive."""
    power, vectors = np.linalg.eigh((density + density.conj().transpose(0, 2, 1)) / 2)
    root = np.sqrt(np.maximum(power, LEAST * np.median(power[:, -1])))
    return np.asarray((vectors / root[:, None, :]) @ vectors.conj().transpose(0, 2, 1))


def _columns(model: BandModel, omega: np.ndarray) -> np.ndarray:
    """Give what each unknown of a channel adds to its densities with the combinations."""
    gain = 1.0 / (1j * omega[:, None] - model.pole)
    by_shape = gain[:, :, None] * model.force.conj().T
    by_force = gain.conj()[:, :, None] * model.shape.conj().T
    unit = np.broadcast_to(np.eye(len(model.shape)), (len(omega), *[len(model.shape)] * 2))
    return np.concatenate([by_shape, by_force, unit, omega[:, None, None] * unit], axis=1)


def _explained(
    density: np.ndarray, cross: np.ndarray, power: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Channels as combinations, and the power that is left of each."""
    mean = np.tensordot(weight, density, axes=1)
    shared = np.tensordot(weight, cross, axes=1)
    regression = shared @ np.linalg.pinv(mean, rcond=1e-10, hermitian=True)
    explained = np.einsum("cm,cm->c", regression, shared.conj()).real
    return regression, np.maximum(weight @ power - explained, 0.0)


def _shown(
    shape: np.ndarray, regression: np.ndarray, covariance: np.ndarray, own: np.ndarray
) -> ShapeWithErrors:
    """Of unit norm; what only lengthens or turns a shape is no error of it."""
    length = float(np.linalg.norm(shape))
    unit = shape / length
    across = np.eye(len(unit)) - np.outer(unit, unit.conj())
    moved = regression @ covariance @ regression.conj().T + np.diag(own)
    variance = np.diag(across @ moved @ across).real / length**2
    return unit, np.sqrt(np.maximum(variance, 0.0))

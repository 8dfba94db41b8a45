r"""Shapes of fitted modes in the combinations of channels that their fit left out.

The likelihood of a band is that of few combinations of channels, :math:`y`. Given these, any
other combination :math:`y_c` has the mean

.. math:: \mathrm{E}(y_c | y) = S_{cy} S_{yy}^{-1} y , \qquad
          S_{cy} = \sum_j \left( \delta_j g_j^H h_j + \gamma_j \phi_j^H \bar h_j \right)
                   + R_0 + R_1 \omega ,

in which the component :math:`\delta_j` of each shape, the component :math:`\gamma_j` of each
force and the background are linear: they are found by weighted least squares. The variance is
that of the residuals as they are (heteroscedasticity-consistent), so that what other modes
leave in :math:`y_c` counts.

References
----------
.. [1] H. White, "A heteroskedasticity-consistent covariance matrix estimator and a direct test
   for heteroskedasticity", Econometrica 48 (1980).
"""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float, Int

from .evaluation import inverse_density
from .model import BandData, BandModel

SMOOTHED = 9
"""Groups over which the power of residuals is averaged for the weights [groups]. Source:
judgement: a single ordinate scatters by its own size, and a mean of nine by a third."""
LEAST_POWER = 1e-3
"""Power of residuals below this share of the largest counts as that [1]. Source: judgement: no
part of a window shall weigh a thousand times as much as another."""
SINGULAR = 1e-12
"""Eigenvalues of the scaled normal equations below this share of the largest count as zero [1].
Source: rounding of products of double precision."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Ordinates:
    """Coefficients of a window, channel by channel, and the group of each."""

    scaled: Complex[np.ndarray, "ordinate channel"]
    group: Int[np.ndarray, " ordinate"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ShapeComplement:
    """Components of shapes outside the fitted combinations of channels.

    Parameters
    ----------
    component
        Of each mode along them, in the unit of its fitted shape.
    covariance
        Of these components, for each mode.
    """

    outside: Complex[np.ndarray, "channel direction"]
    component: Complex[np.ndarray, "direction mode"]
    covariance: Complex[np.ndarray, "mode direction direction"]


def shape_complement(
    ordinates: Ordinates,
    directions: Complex[np.ndarray, "channel kept"],
    data: BandData,
    model: BandModel,
) -> ShapeComplement | None:
    """Estimate the shapes of a fitted band in all remaining combinations of channels.

    None where no combination was left out.
    """
    channels, kept = directions.shape
    if channels == kept:
        return None
    outside = np.linalg.svd(directions)[0][:, kept:]
    y, target = ordinates.scaled @ directions.conj(), ordinates.scaled @ outside.conj()
    terms, group = _terms(data, model), ordinates.group
    starts = np.flatnonzero(np.diff(group, prepend=-1))
    own = np.add.reduceat(y[:, :, None] * y[:, None].conj(), starts, axis=0)
    cross = np.add.reduceat(y[:, :, None].conj() * target[:, None], starts, axis=0)
    seen = terms @ own @ terms.conj().transpose(0, 2, 1)
    size = np.sqrt(np.real(np.diagonal(seen.sum(axis=0))))
    terms = terms / np.where(size > 0, size, 1.0)[:, None]
    normal = terms @ own @ terms.conj().transpose(0, 2, 1)
    right = terms.conj() @ cross

    def solve(weight: Float[np.ndarray, " group"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return coefficients, the inverse of the normal equations, and residuals."""
        inverse = _inverse(np.tensordot(weight, normal, 1).T)
        found = inverse @ np.tensordot(weight, right, 1)
        gain = (found.T @ terms)[group]
        return found, inverse, target - (gain @ y[:, :, None])[:, :, 0]

    weight = 1.0 / _residual_power(solve(np.ones(len(terms)))[2], starts)
    found, inverse, left = solve(weight)
    free = len(model.pole) - model.held
    # Influence of each ordinate on the components of the shapes.
    pull = (inverse[:free].conj() @ (terms * weight[:, None, None]))[group]
    power = np.abs((pull @ y[:, :, None])[:, :, 0]) ** 2
    power *= len(y) / max(len(y) - terms.shape[1], 1)
    spread = [(left * power[:, [k]]).T @ left.conj() for k in range(free)]
    scale = np.where(size > 0, size, 1.0)[:free]
    return ShapeComplement(
        outside,
        (found[:free] / scale[:, None]).T,
        np.array(spread) / scale[:, None, None] ** 2,
    )


def _terms(data: BandData, model: BandModel) -> Complex[np.ndarray, "group term kept"]:
    """Matrices that turn the fitted combinations into the terms of all others."""
    # Terms are the shapes of all modes, their forces, the level of the background and its
    # slope.
    gain, _ = model.gain(data.omega, data.width)
    precision, _ = inverse_density(model.density_of_gain(data.omega, gain))
    if precision is None:
        raise ValueError("A density is not positive definite. Give a fitted model.")
    ahead = (model.force.conj().T @ precision) * gain.T[:, :, None]
    back = (model.shape.conj().T @ precision) * gain.conj().T[:, :, None]
    return np.concatenate(
        [ahead, back, precision, data.omega[:, None, None] * precision], axis=1
    )


def _inverse(normal: Complex[np.ndarray, "term term"]) -> Complex[np.ndarray, "term term"]:
    """Inverse of normal equations on what the data determine."""
    power, turned = np.linalg.eigh(normal)
    known = power > SINGULAR * power[-1]
    return np.asarray((turned[:, known] / power[known]) @ turned[:, known].conj().T)


def _residual_power(
    left: Complex[np.ndarray, "ordinate direction"], starts: Int[np.ndarray, " group"]
) -> Float[np.ndarray, " group"]:
    """Power of residuals, each combination in its own unit, averaged over nearby groups."""
    square = np.abs(left) ** 2
    mean = square.mean(axis=0)
    if not (mean > 0).any():
        return np.ones(len(starts))
    relative = (square[:, mean > 0] / mean[mean > 0]).mean(axis=1)
    window = np.ones(min(SMOOTHED, len(starts)))
    total = np.convolve(np.add.reduceat(relative, starts), window, "same")
    number = np.convolve(np.diff(starts, append=len(left)).astype(float), window, "same")
    return np.asarray(np.maximum(total / number, LEAST_POWER * (total / number).max()))

r"""Fisher information and score of the spectral likelihood of a band.

Every derivative of the density is the Hermitian part of an outer product,

.. math:: \mathrm{d} S(\omega) = z \, e_i v_q^H(\omega) + \bar z \, v_q(\omega) e_i^H, \qquad
          v_q(\omega) = c_q(\omega) \, b_q ,

with a complex coordinate z for each direction i and each of the vectors v: the forces times the
response of their modes (for shapes), the shapes times it (for forces), the forces times its
slope (for poles), and the unit vectors (for the background). With the inverse density P, the
information :math:`\sum n \, \mathrm{tr}(P \, \mathrm{d}S \, P \, \mathrm{d}S')` is

.. math:: 2 \, \mathrm{Re} \sum_\omega n \left( z z' \, K_{q i'} K_{q' i}
          + z \bar z' \, C_{q q'} P_{i' i} \right), \qquad
          K = v^H P, \quad C = v^H P v ,

sums over ordinates of products of two scalars, which are two matrix products for all parameters
together. No derivative is ever formed.
"""

import dataclasses
import functools

import numpy as np
from jaxtyping import Complex, Float

from .model import BandData, BandModel

GAUGE = 1e-9
"""Eigenvalues of the information below this share of the largest count as zero [1]."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Tangents:
    r"""Vectors :math:`v_q = c_q b_q`, and :math:`K = v^H P`."""

    base: Complex[np.ndarray, "vector direction"]
    scalar: Complex[np.ndarray, "vector group"]
    seen: Complex[np.ndarray, "vector direction group"]

    @staticmethod
    def of(base: np.ndarray, scalar: np.ndarray, precision: np.ndarray) -> "Tangents":
        """Vectors beside an inverse density, ["direction direction group"]."""
        directions = base.shape[1]
        seen = base.conj() @ precision.reshape(directions, -1)
        seen = seen.reshape(len(base), directions, -1)
        seen *= scalar.conj()[:, None]
        return Tangents(base, scalar, seen)

    def score(
        self, surprise: Complex[np.ndarray, "direction direction group"]
    ) -> Complex[np.ndarray, "vector direction 1"]:
        """Sum of :math:`v^H E e_i` over the groups, for a matrix E of each group."""
        directions = self.base.shape[1]
        pulled = self.base.conj() @ surprise.reshape(directions, -1)
        pulled = pulled.reshape(len(self.base), directions, -1)
        return np.asarray(pulled @ self.scalar.conj()[:, :, None])


def cross_information(
    one: Tangents,
    other: Tangents,
    precision: Complex[np.ndarray, "direction direction group"],
    number: Float[np.ndarray, " group"],
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the sums that go with z z' and with z times the conjugate of z'.

    Both have the shape ["vector direction vector direction"].
    """
    directions, groups = precision.shape[1:]
    sizes = (len(one.base), directions, len(other.base), directions)
    plain = (one.seen * number).reshape(-1, groups) @ other.seen.reshape(-1, groups).T
    product = other.base @ one.seen
    # In place: a second array of this size would cost more than the sums.
    product *= other.scalar * number
    turned = product.reshape(-1, groups) @ precision.reshape(-1, groups).T
    turned = turned.reshape(sizes[0], sizes[2], directions, directions)
    return plain.reshape(sizes).transpose(0, 3, 2, 1), turned.transpose(0, 3, 1, 2)


class ModelTangents:
    """Derivatives of a density by the free parameters of its model."""

    def __init__(
        self,
        data: BandData,
        model: BandModel,
        gain: np.ndarray,
        bent: np.ndarray,
        precision: np.ndarray,
    ) -> None:
        free = len(model.pole) - model.held
        moving = 0 if model.still else free
        directions, modes = model.shape.shape
        self._layout = layout_of(moving, free, modes, directions)
        self._shape = model.shape[:, :moving].T[:, None]
        self._scale = np.ones(len(self._layout.real))
        self._scale[: 2 * moving : 2] = model.pole.real[:moving]
        unit, one = np.eye(directions), np.ones((directions, len(data.omega)))
        base = [model.force.T[:moving], model.force.T[:free], model.shape.T, unit, unit]
        scalar = [bent[:moving].conj(), gain[:free].conj(), gain, one, one * data.omega]
        self.vectors = Tangents.of(np.concatenate(base), np.concatenate(scalar), precision)

    def coordinates(self, whole: np.ndarray, *, conjugate: bool = False) -> np.ndarray:
        """Complex coordinates of the parameters, from those of all vectors and directions.

        From ["vector direction other"] to ["coordinate other"]: poles, shapes, forces, level
        and slope of the background.
        """
        layout, others = self._layout, whole.shape[2]
        linear = whole.reshape(-1, others)[layout.index] * layout.share
        if not layout.moving:
            return np.asarray(linear)
        shape = self._shape.conj() if conjugate else self._shape
        return np.concatenate([(shape @ whole[: layout.moving])[:, 0], linear])

    def real_parameters(self, rows: np.ndarray) -> np.ndarray:
        """Rows of all real parameters, from real and imaginary parts of the coordinates."""
        return np.asarray(rows[self._layout.real] * self._scale[:, None])

    def information(self, precision: np.ndarray, number: np.ndarray) -> np.ndarray:
        """Information of all free parameters."""
        plain, turned = cross_information(self.vectors, self.vectors, precision, number)
        size = len(self.vectors.base), len(precision)
        found = []
        for sums, conjugate in ((plain, False), (turned, True)):
            half = self.coordinates(sums.reshape(*size, -1)).T.reshape(*size, -1)
            found.append(self.coordinates(half, conjugate=conjugate).T)
        whole = real_rows(*found)
        return self.real_parameters(self.real_parameters(whole).T)

    def score(self, surprise: np.ndarray) -> np.ndarray:
        """Slopes of the log-likelihood along all free parameters."""
        slopes = real_slopes(self.coordinates(self.vectors.score(surprise))[:, 0])
        return self.real_parameters(slopes[:, None])[:, 0]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _CoordinateLayout:
    """Where the coordinates of the parameters are among those of vectors and directions.

    Parameters
    ----------
    moving
        Poles that are free: coordinates of their own, the first.
    index, share
        Of all others, and their factors as a column.
    """

    moving: int
    index: np.ndarray
    share: np.ndarray
    real: np.ndarray


@functools.cache
def layout_of(moving: int, free: int, modes: int, directions: int) -> _CoordinateLayout:
    """Layout of the parameters of a model."""
    low, high = np.tril_indices(directions)
    first = moving + free + modes
    shapes_and_forces = np.arange(moving * directions, first * directions)
    level = (first + high) * directions + low
    share = np.where(low == high, 0.5, 1.0)
    share = np.concatenate([np.ones(len(shapes_and_forces)), share, share])
    index = np.concatenate([shapes_and_forces, level, level + directions**2])
    before = moving + len(shapes_and_forces)
    own = 2 * (before + np.flatnonzero(low == high)) + 1
    real = np.arange(2 * (moving + len(index)))
    real = np.delete(real, np.concatenate([own, own + 2 * len(low)]))
    return _CoordinateLayout(moving, index, share[:, None], real)


def real_rows(plain: np.ndarray, turned: np.ndarray) -> np.ndarray:
    """Products of real and imaginary parts of two sets of coordinates.

    `plain` and `turned` go with z z' and with z times the conjugate of z'; real and imaginary
    parts are rows in turn.
    """
    whole = np.empty((2 * plain.shape[0], 2 * plain.shape[1]))
    both, apart = plain + turned, turned - plain
    whole[::2, ::2], whole[1::2, 1::2] = both.real, apart.real
    whole[::2, 1::2], whole[1::2, ::2] = apart.imag, -both.imag
    return 2.0 * whole


def real_slopes(slopes: np.ndarray) -> np.ndarray:
    """Slopes along real and imaginary parts in turn, from sums that go with z."""
    return np.asarray(2.0 * slopes.conj()).view(float)


def surprise_of(
    data: BandData, density: np.ndarray, precision: np.ndarray
) -> Complex[np.ndarray, "direction direction group"]:
    """Gap of data and density between inverse densities, times the number of ordinates.

    Groups are first in the arguments, and last in the result.
    """
    between = precision @ (data.density - density) @ precision
    return np.ascontiguousarray((between * data.number[:, None, None]).transpose(1, 2, 0))


def information_and_score(
    data: BandData,
    model: BandModel,
    predicted: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Fisher information and score of a model that has been evaluated.

    `predicted` holds the response of the modes and its slope; density and its inverse.
    """
    gain, bent, density, inverse = predicted
    precision = np.ascontiguousarray(inverse.transpose(1, 2, 0))
    tangents = ModelTangents(data, model, gain, bent, precision)
    score = tangents.score(surprise_of(data, density, inverse))
    return add_prior(model, tangents.information(precision, data.number), score)


def add_prior(
    model: BandModel, information: np.ndarray, score: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Add prior information and score of the poles."""
    modes = 0 if model.still else len(model.pole) - model.held
    away, wide = (each[:, :modes].T.reshape(-1) for each in model.ties())
    own = np.arange(2 * modes)
    information[own, own] += wide**-2
    score[own] -= away / wide**2
    return information, score


def restricted_inverse(information: np.ndarray) -> np.ndarray:
    """Inverse of an information matrix on the parameters that the data determine.

    It is zero along length and phase of the shapes.
    """
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    power, directions = np.linalg.eigh(information / scale[:, None] / scale)
    keep = power > GAUGE * power[-1]
    inverse = (directions[:, keep] / power[keep]) @ directions[:, keep].T
    return np.asarray(inverse / scale[:, None] / scale)

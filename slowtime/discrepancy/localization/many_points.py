r"""Products of pairs of many points that move by few coordinates, as those of a reduced model.

Where something between two points is missing, whatever its law, it acts as one force along
their elongation, which explains of the whitened residual :math:`r` at each line

.. math:: \max_w \left( |r|^2 - |r - g_b w|^2 \right) = |g_b^H r|^2 / |g_b|^2 ,

with :math:`g_b` the whitened readings of a unit force. The pair that explains most is likely,
however large its force is. Small forces are better told from constants by linearisation
(`pair_ranking`).
"""

import dataclasses
from collections.abc import Iterator

import numpy as np
from jaxtyping import Complex, Float, Int

from .latent_force import LatentForceSolver
from .perturbed_reference import PerturbedReference

CHUNK_NUMBERS = 4_000_000
"""[numbers] Lines times pairs that are held at once. Source: a bound on memory, 64 MB."""

TINY = float(np.finfo(float).tiny)

Ends = Int[np.ndarray, "pair 2"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class PointShapes:
    """Motion of points that are no coordinates of a model, such as a reduced one.

    Parameters
    ----------
    flexibility
        Displacements [m/N] by forces on the points that the coordinates lack.
    """

    names: tuple[str, ...]
    shapes: Float[np.ndarray, "point coordinate"]
    flexibility: Float[np.ndarray, "point point"]

    def along(self, first: str, second: str) -> float:
        """Elongation of a pair by a unit force that the coordinates lack [m/N]."""
        rows = [self.names.index(name) for name in (first, second) if name in self.names]
        signs = np.array([1.0, -1.0])[: len(rows)]
        return float(signs @ self.flexibility[np.ix_(rows, rows)] @ signs)


def free_force_gains(
    solver: LatentForceSolver, points: PointShapes, ends: Ends
) -> Float[np.ndarray, " pair"]:
    """Log likelihood [nats] that a free force between each pair of points gains.

    The ground has the number behind all others.
    """
    found = np.zeros(len(ends))
    still = np.zeros((1, points.shapes.shape[1]))
    shapes = np.concatenate([points.shapes, still]).T
    for tuned in solver.tuned:
        root = np.sqrt(tuned.trial.noise)
        response = (tuned.sensed @ shapes) / root[:, :, None]
        residual = tuned.residual / root
        seen = np.einsum("fsp,fs->fp", response.conj(), residual)
        for lines, power in _signal_powers(response, ends):
            along = seen[lines][:, ends[:, 1]] - seen[lines][:, ends[:, 0]]
            found += np.sum(np.abs(along) ** 2 / np.maximum(power, TINY), axis=0)
    return found


def own_products(
    response: Complex[np.ndarray, "frequency sensor point"],
    motion: Complex[np.ndarray, "order frequency point"],
    ends: Ends,
) -> Float[np.ndarray, "pair order order"]:
    """Real products of what spring, damper and mass of each pair add with each other."""
    orders = len(motion)
    found = np.zeros((len(ends), orders, orders))
    for lines, power in _signal_powers(response, ends):
        moved = motion[:, lines][:, :, ends[:, 1]] - motion[:, lines][:, :, ends[:, 0]]
        for one in range(orders):
            weighted = moved[one].conj() * power
            for other in range(one, orders):
                found[:, one, other] += np.sum((weighted * moved[other]).real, axis=0)
                found[:, other, one] = found[:, one, other]
    return found


def _signal_powers(
    response: Complex[np.ndarray, "frequency sensor point"], ends: Ends
) -> Iterator[tuple[slice, Float[np.ndarray, "line pair"]]]:
    """Squared readings of a unit force between each pair, some lines at a time."""
    first, second = ends.T
    step = max(CHUNK_NUMBERS // max(len(ends), response.shape[2] ** 2), 1)
    for start in range(0, len(response), step):
        lines = slice(start, start + step)
        parts = response[lines]
        both = np.concatenate([parts.real, parts.imag], axis=1)
        gram = np.swapaxes(both, 1, 2) @ both
        own = np.einsum("fpp->fp", gram)
        yield lines, own[:, first] + own[:, second] - 2 * gram[:, first, second]


def along_pairs(
    tuned: PerturbedReference,
    columns: Complex[np.ndarray, "frequency sensor column"],
    shapes: Float[np.ndarray, "coordinate point"],
    ends: np.ndarray,
) -> Float[np.ndarray, "pair order column"]:
    """Real products of what spring, damper and mass of each pair add with columns."""
    trial, count = tuned.trial, len(shapes)
    orders, lines, _ = trial.motion.shape
    sensed = tuned.sensed / np.sqrt(trial.noise)[:, :, None]
    moved = np.ascontiguousarray(np.moveaxis(trial.motion.conj(), 1, 2).reshape(-1, lines))
    table = np.empty((count, orders * count * columns.shape[2]))
    for force in range(count):
        heard = (sensed[:, :, force].conj()[:, None, :] @ columns)[:, 0]
        table[force] = (moved @ heard).real.ravel()
    found = np.zeros((len(ends), orders, columns.shape[2]))
    for point, along in enumerate(shapes.T):
        if not along.any():
            continue
        pushed = shapes.T @ (along @ table).reshape(orders, count, -1)
        for side, other in ((1, 0), (0, 1)):
            own = ends[:, side] == point
            elongation = pushed[:, ends[own, side]] - pushed[:, ends[own, other]]
            found[own] += np.moveaxis(elongation, 0, 1)
    return found

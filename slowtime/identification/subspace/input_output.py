r"""Subspace identification with measured inputs, with first-order errors of the poles.

With future outputs and inputs :math:`Y_f, U_f` and past of both :math:`Z_p`, and sums S over
the samples, the part of the future that the past foretells beside the inputs,

.. math:: H = S_{yz} - S_{yu} S_{uu}^{-1} S_{uz} ,

has the column space of the observability matrix (N4SID, PO-MOESP). Both sides are whitened by
what the inputs leave of their covariances (canonical variate analysis). Sums over parts of the
record tell the error of H to first order,

.. math:: \delta H = \begin{pmatrix} I & -S_{yu} S_{uu}^{-1} \end{pmatrix} \delta S
          \begin{pmatrix} I \\ -S_{uu}^{-1} S_{uz} \end{pmatrix} ,

which does not depend on how the strength of the inputs varies between the parts, as in an
earthquake: all that the inputs explain cancels in it.

References
----------
.. [1] P. Van Overschee, B. De Moor, "Subspace Identification for Linear Systems" (1996),
   chapter 4.
.. [2] W. E. Larimore, "Canonical variate analysis in identification, filtering, and adaptive
   control", IEEE CDC 29 (1990).
.. [3] P. Mellinger, M. Döhler, L. Mevel, "Variance estimation of modal parameters from
   output-only and input/output subspace-based system identification", J. Sound and Vibration
   379 (2016).
"""

import math

import numpy as np
import scipy.linalg
from jaxtyping import Float

from slowtime.signals.decimation import decimated

from .model_orders import WeightedSubspace, joined_poles, whitening
from .order_recursion import poles_of_orders
from .poles import Poles, rescale_channels

BLOCK_ROWS = 20
"""Samples of past and of future."""

MOST_ROWS = 400
"""Rows of the past at most: many channels get fewer block rows."""

MOST_ORDER = 40
"""Highest order: two for each mode."""

PARTS = 20
"""Parts of the record, by which errors are told."""

OVERSAMPLING = 2.6
"""Sampling rate over the highest frequency sought, at least."""


def input_output_poles(
    inputs: Float[np.ndarray, "time input"],
    outputs: Float[np.ndarray, "time output"],
    rate_hz: float,
    *,
    highest_hz: float,
) -> Poles:
    """Poles of models of all orders, with errors.

    Records have no offsets, and are decimated to fit `highest_hz`. Shapes have unit norm over
    the outputs. Raises `ValueError` where the record is too short.
    """
    factor = max(1, math.floor(rate_hz / (OVERSAMPLING * highest_hz)))
    if factor > 1:
        both = decimated(np.concatenate([inputs, outputs], axis=1), rate_hz, factor)
        inputs, outputs = np.split(both.samples, [inputs.shape[1]], axis=1)
        rate_hz = both.rate_hz
    scale_u, scale_y = inputs.std(axis=0), outputs.std(axis=0)
    rows = min(BLOCK_ROWS, max(4, MOST_ROWS // (inputs.shape[1] + outputs.shape[1])))
    stacked = _stacked(inputs / scale_u, outputs / scale_y, rows)
    if len(stacked) < 2 * stacked.shape[1]:
        raise ValueError(
            f"{len(inputs)} samples at {rate_hz:g} Hz are too few for {stacked.shape[1]} rows "
            "of past and future. Give a longer record or fewer channels."
        )
    sizes = (rows * outputs.shape[1], rows * (outputs.shape[1] + inputs.shape[1]))
    subspace = _subspace(stacked, sizes, outputs.shape[1], rate_hz)
    highest = min(MOST_ORDER, subspace.u.shape[1], (rows - 1) * outputs.shape[1])
    orders = range(1, highest + 1)
    parts = poles_of_orders(subspace, orders, 0.0)
    found = joined_poles(parts, len(inputs) / rate_hz)
    return rescale_channels(found, scale_y)


def _stacked(inputs: np.ndarray, outputs: np.ndarray, rows: int) -> np.ndarray:
    """Future outputs, future inputs, past inputs and past outputs of each instant."""
    count = len(inputs) - 2 * rows + 1
    if count < 1:
        return np.zeros((0, 4 * rows))

    def lagged(series: np.ndarray, first: int) -> np.ndarray:
        return np.concatenate(
            [series[first + k : first + k + count] for k in range(rows)], axis=1
        )

    return np.concatenate(
        [lagged(outputs, rows), lagged(inputs, rows), lagged(inputs, 0), lagged(outputs, 0)],
        axis=1,
    )


def _subspace(
    stacked: np.ndarray, sizes: tuple[int, int], channels: int, rate_hz: float
) -> WeightedSubspace:
    y, u, z = slice(0, sizes[0]), slice(sizes[0], sizes[1]), slice(sizes[1], None)
    parts = [part.T @ part / len(part) for part in np.array_split(stacked, PARTS)]
    total = stacked.T @ stacked / len(stacked)
    ridge = 1e-9 * np.trace(total[u, u]) / (sizes[1] - sizes[0])
    inverse = scipy.linalg.inv(total[u, u] + ridge * np.eye(sizes[1] - sizes[0]))
    of_y, of_z = total[y, u] @ inverse, inverse @ total[u, z]
    future = whitening(total[y, y] - of_y @ total[u, y], sizes[0], total.dtype)
    left_of_past = total[z, z] - total[z, u] @ of_z
    past = whitening(left_of_past, len(left_of_past), total.dtype)
    hankel = total[y, z] - of_y @ total[u, z]
    vectors, values, turned = scipy.linalg.svd(
        future.left @ hankel @ past.left, full_matrices=False
    )
    largest = min(MOST_ORDER, int(np.count_nonzero(values > 1e-10 * values[0])))
    reached = past.left @ (turned[:largest].T / values[:largest])
    errors = []
    for part in parts:
        change = part - total
        moved = change[y, z] - of_y @ change[u, z] - change[y, u] @ of_z
        moved = moved + of_y @ change[u, u] @ of_z
        errors.append(future.left @ (moved @ reached) / math.sqrt(PARTS - 1))
    return WeightedSubspace(
        vectors[:, :largest],
        future.inverse @ vectors[:, :largest],
        np.stack(errors),
        future.inverse,
        channels,
        rate_hz,
    )

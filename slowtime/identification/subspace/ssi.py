r"""Stochastic subspace identification, covariance-driven and data-driven.

Correlations of a structure under white force obey :math:`R_\tau = C A^{\tau-1} G`. The Hankel
matrix of their blocks has the rank of the model; its singular vectors give C and A, and a model
of any lower order is a leading part of the same vectors.

Errors travel to first order, without a large matrix ever being formed. With
:math:`U S V^H` the leading n singular triplets of the (weighted) Hankel matrix H, left and
right eigenvectors :math:`\chi, \psi` of A and the observability matrix :math:`\Gamma`,

.. math:: \delta\mu = x^H \, \delta H \, y, \qquad
          y = V S^{-1} \psi, \quad
          x^H = \chi^H \Gamma_\uparrow^+ (S_\downarrow - \mu S_\uparrow) (I - U U^H)

is the error of a pole. :math:`\delta H V S^{-1}` is computed once for each draw of
:class:`Correlations`; every order takes its leading columns, and a pole or a component of its
shape then costs one inner product per draw.

Everything holds for real series and for complex ones (a band moved to zero frequency) alike.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np
import scipy.linalg
from jaxtyping import Float, Inexact

from slowtime.identification import checks

from .correlations import Correlations, block_hankel, correlation_matrices
from .model_orders import (
    WeightedSubspace,
    Whitening,
    joined_poles,
    poles_of_order,
    whitening,
)
from .order_recursion import poles_of_orders
from .poles import PoleLimits, rescale_channels
from .poles import Poles as Poles

Weighting = Literal["none", "past", "both"]


def ssi_covariance(
    samples: Float[np.ndarray, "time channel"],
    rate_hz: float,
    *,
    block_rows: int,
    orders: Sequence[int],
    references: Sequence[int] | None = None,
    shapes: bool = True,
    weighting: Weighting = "none",
) -> Poles:
    """Covariance-driven stochastic subspace identification, with uncertainty at every order.

    Parameters
    ----------
    block_rows
        Lags in a block row or column; twice as many are used.
    orders
        Model orders, two for each mode.
    references
        Channels to correlate with; all by default.
    weighting
        See `identify_poles`. `both` is the best at orders beyond what there is; it needs all
        channels as references.

    References
    ----------
    .. [1] P. Van Overschee, B. De Moor, "Subspace Identification for Linear Systems" (1996).
    .. [2] E. Reynders, R. Pintelon, G. De Roeck, "Uncertainty bounds on modal parameters
       obtained from stochastic subspace identification", MSSP 22 (2008).
    .. [3] M. Döhler, L. Mevel, "Efficient multi-order uncertainty computation for stochastic
       subspace identification", MSSP 38 (2013).
    """
    return _of_samples(samples, rate_hz, block_rows, orders, references, shapes, weighting)


def identify_poles(
    correlations: Correlations,
    *,
    block_rows: int,
    orders: Sequence[int],
    weighting: Weighting = "none",
    mixing: Inexact[np.ndarray, "reference channel"] | None = None,
    shapes: bool = False,
    errors_within: PoleLimits | None = None,
) -> Poles:
    r"""Poles of all `orders` from one singular value decomposition.

    Parameters
    ----------
    correlations
        At least ``2 * block_rows`` lags of them. Lag 0 is not used, as it holds the noise.
    block_rows
        Blocks p of the p by p Hankel matrix.
    orders
        Ranks kept.
    weighting
        What whitens the Hankel matrix: nothing (covariance-driven), the past (data-driven,
        UPC), or past and future (CVA), which shows a weak mode beside a strong one.
    mixing
        M of the references :math:`r = M y`; the channels themselves by default.
    errors_within
        Poles whose errors are computed, unless those of shapes are; all by default.

    References
    ----------
    .. [1] P. Van Overschee, B. De Moor, "Subspace Identification for Linear Systems" (1996),
       table 3.1 for the weightings.
    """
    needed = 2 * block_rows
    available, channels, references = correlations.mean.shape
    largest = min(max(orders), (block_rows - 1) * channels, block_rows * references)
    if block_rows < 2 or min(orders) < 1 or needed > available:
        raise ValueError(
            f"{block_rows=} and orders from {min(orders)} need {needed} lags, and {available} "
            "were given. Give at least 2 block rows, orders from 1, and as many lags."
        )
    mean = correlations.mean[1:needed]
    draws = correlations.draws[:, 1:needed]
    hankel = block_hankel(mean, block_rows, block_rows)
    past, future = _whitening(correlations, block_rows, weighting, mixing)
    u, s, vh = scipy.linalg.svd(future.left @ hankel @ past.left, full_matrices=False)
    largest = min(largest, int(np.count_nonzero(s > 1e-13 * s[0])))
    gamma = future.inverse @ u[:, :largest]
    reached = past.left @ (vh[:largest].conj().T / s[:largest])
    errors = np.stack(
        [future.left @ (block_hankel(draw, block_rows, block_rows) @ reached) for draw in draws]
    )
    subspace = WeightedSubspace(
        u[:, :largest], gamma, errors, future.inverse, channels, correlations.rate_hz
    )
    chosen = sorted({n for n in orders if n <= largest})
    if shapes:
        parts = [poles_of_order(subspace, n, correlations.centre_hz, True) for n in chosen]
    else:
        parts = poles_of_orders(subspace, chosen, correlations.centre_hz, errors_within)
    return joined_poles(parts, correlations.duration_s)


def _toeplitz(lagged: np.ndarray, rows: int) -> np.ndarray:
    """Block (i, j) is lag i - j of square correlations, negative lags by symmetry."""
    both = np.concatenate([lagged[rows - 1 : 0 : -1].conj().transpose(0, 2, 1), lagged[:rows]])
    index = np.arange(rows)[:, None] - np.arange(rows) + rows - 1
    size = rows * lagged.shape[1]
    return np.asarray(both[index].transpose(0, 2, 1, 3).reshape(size, size))


def _whitening(
    correlations: Correlations, rows: int, weighting: Weighting, mixing: np.ndarray | None
) -> tuple[Whitening, Whitening]:
    """Inverse square roots of the covariances of past and future, and their inverses."""
    channels, references = correlations.mean.shape[1:]
    past = future = None
    if weighting != "none":
        if mixing is None and references != channels:
            raise ValueError(
                f"{references} references of {channels} channels were given without "
                "`mixing`. State in `mixing` which they are, or choose weighting='none'."
            )
        mean = correlations.mean[:rows]
        own = mean if mixing is None else np.einsum("rc,lcs->lrs", mixing, mean)
        # Column block j of the Hankel matrix is j instants before the present.
        past = _toeplitz(own.conj().transpose(0, 2, 1), rows)
    if weighting == "both":
        if references != channels:
            raise ValueError(
                "weighting='both' needs every channel as a reference. Choose 'past'."
            )
        future = _toeplitz(correlations.mean[:rows], rows)
    return (
        whitening(past, rows * references, correlations.mean.dtype),
        whitening(future, rows * channels, correlations.mean.dtype),
    )


def _of_samples(
    samples: np.ndarray,
    rate_hz: float,
    block_rows: int,
    orders: Sequence[int],
    references: Sequence[int] | None,
    shapes: bool,
    weighting: Weighting,
) -> Poles:
    columns = checks.series(samples, rate_hz)
    if columns.shape != samples.shape:
        raise ValueError(
            f"Of {samples.shape[1]} channels {columns.shape[1]} move. Leave the others out."
        )
    columns = columns - columns.mean(axis=0)
    scale = columns.std(axis=0)
    scaled = columns / scale
    chosen = list(range(columns.shape[1])) if references is None else list(references)
    found = correlation_matrices(
        scaled, scaled[:, chosen], lags=2 * block_rows, rate_hz=rate_hz
    )
    poles = identify_poles(
        found,
        block_rows=block_rows,
        orders=orders,
        weighting=weighting,
        mixing=np.eye(columns.shape[1])[chosen],
        shapes=shapes,
    )
    return rescale_channels(poles, scale)

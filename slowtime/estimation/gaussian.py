r"""What is believed of a state, held as a root of its covariance, and one step of any filter.

.. math:: P = S S^T

with S lower triangular. Sums of covariances are roots laid side by side and turned triangular
by an orthogonal transformation; nothing is ever subtracted, so that no covariance can lose its
positivity to rounding. Every array may have axes of twins in front: what is done is done for
all of them at once.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import chdtri

_LOG_TWO_PI = float(np.log(2.0 * np.pi))


@dataclasses.dataclass(frozen=True, slots=True)
class Gaussian:
    """What is believed of a state.

    Parameters
    ----------
    mean
        Of the state.
    root
        Lower triangular, times its transpose the covariance. `Gaussian.of` takes a covariance.
    """

    mean: Float[np.ndarray, "*twins state"]
    root: Float[np.ndarray, "*twins state state"]

    @classmethod
    def of(
        cls,
        mean: Float[np.ndarray, "*twins state"],
        covariance: Float[np.ndarray, "*twins state state"],
    ) -> "Gaussian":
        """Make a belief from a covariance, which may be singular.

        Parameters
        ----------
        mean
            Mean of the state.
        covariance
            Covariance of the state.

        Returns
        -------
        The belief.

        Raises
        ------
        ValueError
            Where the matrix is no covariance.

        Examples
        --------
        >>> Gaussian.of(np.zeros(1), np.array([[4.0]])).root
        array([[2.]])
        """
        return cls(mean, root_of(covariance))

    @property
    def covariance(self) -> Float[np.ndarray, "*twins state state"]:
        """Symmetric, and positive whatever the rounding."""
        product = self.root @ np.swapaxes(self.root, -1, -2)
        return np.asarray(0.5 * (product + np.swapaxes(product, -1, -2)))

    @property
    def sd(self) -> Float[np.ndarray, "*twins state"]:
        """Standard deviations."""
        return np.asarray(np.sqrt(np.sum(self.root**2, axis=-1)))


@dataclasses.dataclass(frozen=True, slots=True)
class FilterStep:
    """One step of a filter: belief before the reading and after it, and how well it fitted.

    Parameters
    ----------
    predicted, updated
        Belief before and after the reading.
    before, after
        Deviations in which the state of the step before and the predicted one vary together:
        ``after @ after.T`` is the predicted covariance, ``before @ after.T`` what the two have
        in common. The smoother goes back along them.
    residual
        Reading minus what was expected; NaN where nothing was read.
    spread_root
        Lower triangular root of the covariance of the residual.
    log_likelihood
        Of the reading given all before it [1]; 0 where it is missing or rejected.
    surprise
        Squared residual in units of its expected covariance [1]: its mean over many readings
        is their dimension if the model is right. NIS of the tracking books.
    used
        How many entries of the reading were taken in.
    rejected
        Whether the reading was there, but lay beyond the gate.
    """

    predicted: Gaussian
    updated: Gaussian
    before: Float[np.ndarray, "*twins state deviation"]
    after: Float[np.ndarray, "*twins state deviation"]
    residual: Float[np.ndarray, "*twins reading"]
    spread_root: Float[np.ndarray, "*twins reading reading"]
    log_likelihood: Float[np.ndarray, "*twins"]
    surprise: Float[np.ndarray, "*twins"]
    used: Int[np.ndarray, "*twins"]
    rejected: Bool[np.ndarray, "*twins"]


def triangular(
    columns: Float[np.ndarray, "*twins row column"],
) -> Float[np.ndarray, "*twins row row"]:
    """Compute the lower triangular L with ``L @ L.T == columns @ columns.T``.

    Parameters
    ----------
    columns
        Any root of a covariance.

    Returns
    -------
    Lower triangular root; its diagonal is not negative.
    """
    rows, count = columns.shape[-2:]
    if count < rows:
        empty = np.zeros((*columns.shape[:-1], rows - count))
        columns = np.concatenate([columns, empty], axis=-1)
    upper = np.linalg.qr(np.swapaxes(columns, -1, -2), mode="r")
    signs = np.where(np.diagonal(upper, axis1=-2, axis2=-1) < 0.0, -1.0, 1.0)
    lower: np.ndarray = np.swapaxes(upper * signs[..., None], -1, -2)
    return lower


def root_of(
    covariance: Float[np.ndarray, "*twins row row"],
) -> Float[np.ndarray, "*twins row row"]:
    """Lower triangular root of a covariance, which may be singular.

    Raises
    ------
    ValueError
        If the matrix is not symmetric, or negative in some direction beyond rounding.
    """
    lopsided = np.abs(covariance - np.swapaxes(covariance, -1, -2)).max(initial=0.0)
    scale = np.abs(covariance).max(initial=0.0)
    if not lopsided <= 1e-8 * scale:
        raise ValueError(
            "The covariance is not symmetric, so it is none. Give the covariance matrix, not a "
            "factor of it."
        )
    # Scaled to a correlation first: states of unlike units lose nothing to each other.
    size = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0.0))
    unit = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / unit[..., :, None] / unit[..., None, :])
    if values.size and not values.min() >= -1e-9 * max(float(values.max()), 1.0):
        raise ValueError(
            f"The matrix has the eigenvalue {values.min():.3g} (scaled to unit variances), so "
            "it is no covariance. Give one that is positive, or zero, in every direction."
        )
    roots = vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]
    return triangular(unit[..., :, None] * roots)


def take_in(
    predicted: Gaussian,
    expected: Float[np.ndarray, "*twins reading"],
    state_deviations: Float[np.ndarray, "*twins state own"],
    reading_deviations: Float[np.ndarray, "*twins reading deviation"],
    reading: Float[np.ndarray, "*twins reading"],
    noise_root: Float[np.ndarray, "... reading noise"],
    gate: float | None,
) -> tuple[Gaussian, dict[str, Any]]:
    r"""Update a belief by a reading, by one orthogonal transformation.

    .. math:: \begin{pmatrix} A_y & R^{1/2} \\ A_x & 0 \end{pmatrix} \Theta =
              \begin{pmatrix} S_y & 0 \\ G & S^+ \end{pmatrix}

    where :math:`A_x, A_y` are deviations of state and reading, the state's in the first
    columns, :math:`G S_y^{-1}` is the gain and :math:`S^+` the root after the reading (Kailath,
    Sayed and Hassibi, 2000, ch. 12).

    Entries of NaN are missing and the rest is used. With a `gate`, a reading whose surprise
    would be met by chance with less than that probability is rejected whole.

    Parameters
    ----------
    predicted
        Belief before the reading.
    expected
        Expected reading.
    state_deviations
        Deviations :math:`A_x` of the state.
    reading_deviations
        Deviations :math:`A_y` of the reading.
    reading
        Reading; NaN entries are missing.
    noise_root
        Root of the covariance of the reading's noise.
    gate
        Probability below which a reading is rejected; None accepts all [1].

    Returns
    -------
    Belief after the reading, and the remaining fields of a `FilterStep`.

    References
    ----------
    .. [1] T. Kailath, A. H. Sayed and B. Hassibi, "Linear Estimation" (2000), ch. 12.
    """
    shape = np.broadcast_shapes(reading.shape, expected.shape)
    there = np.broadcast_to(~np.isnan(reading), shape)
    size, states = shape[-1], state_deviations.shape[-2]
    top = np.concatenate(
        [
            np.where(there[..., None], reading_deviations, 0.0),
            np.where(
                there[..., None],
                np.broadcast_to(noise_root, (*shape[:-1], *noise_root.shape[-2:])),
                0.0,
            ),
            # What is missing is read with a noise of its own, which teaches nothing.
            np.where(there, 0.0, 1.0)[..., None] * np.eye(size),
        ],
        axis=-1,
    )
    below = np.zeros((*shape[:-1], states, top.shape[-1]))
    below[..., : state_deviations.shape[-1]] = state_deviations
    turned = triangular(np.concatenate([top, below], axis=-2))
    spread_root, gain = turned[..., :size, :size], turned[..., size:, :size]
    residual = np.where(there, reading - expected, 0.0)
    white = np.linalg.solve(spread_root, residual[..., None])[..., 0]
    surprise = np.asarray(np.sum(white**2, axis=-1))
    count = np.asarray(there.sum(axis=-1))
    rejected = np.zeros(shape[:-1], dtype=bool)
    if gate is not None:
        rejected = np.asarray((count > 0) & ~(surprise <= chdtri(np.maximum(count, 1), gate)))
    use = np.asarray((count > 0) & ~rejected)
    diagonal = np.diagonal(spread_root, axis1=-2, axis2=-1)
    volume = np.log(diagonal).sum(axis=-1) + 0.5 * _LOG_TWO_PI * count
    mean = predicted.mean + np.where(use[..., None], (gain @ white[..., None])[..., 0], 0.0)
    root = np.where(use[..., None, None], turned[..., size:, size:], predicted.root)
    return Gaussian(mean, root), {
        "residual": np.where(there, residual, np.nan),
        "spread_root": spread_root,
        "log_likelihood": np.where(use, -0.5 * surprise - volume, 0.0),
        "surprise": np.where(count > 0, surprise, 0.0),
        "used": np.where(use, count, 0),
        "rejected": rejected,
    }


def smooth(steps: Sequence[FilterStep]) -> list[Gaussian]:
    r"""Belief at each step given all readings, past and future (Rauch, Tung and Striebel).

    .. math:: C_k = P_{k,k+1} (P^-_{k+1})^{-1}, \quad
              x^s_k = x_k + C_k (x^s_{k+1} - x^-_{k+1}), \quad
              P^s_k = P_k + C_k (P^s_{k+1} - P^-_{k+1}) C_k^T

    for any filter of this room. The covariance is summed from positive parts: what of the
    state the next one does not tell, plus what it tells times how well that is known.
    """
    if not steps:
        return []
    smoothed = [steps[-1].updated]
    for now, following in zip(reversed(steps[:-1]), reversed(steps[1:]), strict=True):
        later, after = smoothed[-1], following.after
        inverse = np.linalg.pinv(triangular(after))
        cross = following.before @ np.swapaxes(after, -1, -2)
        gain = cross @ np.swapaxes(inverse, -1, -2) @ inverse
        ahead = later.mean - following.predicted.mean
        mean = now.updated.mean + (gain @ ahead[..., None])[..., 0]
        own = following.before - gain @ after
        smoothed.append(
            Gaussian(mean, triangular(np.concatenate([own, gain @ later.root], axis=-1)))
        )
    return smoothed[::-1]

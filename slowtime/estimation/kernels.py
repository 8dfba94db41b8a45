r"""Matérn processes and drifting trends as small linear systems between two instants.

A Matérn process of smoothness :math:`\nu = p + 1/2` is the first component of a state of
:math:`p + 1` derivatives driven by white noise (Hartikainen and Särkkä, 2010), so that a
Gaussian process over slow time costs the same for every new reading. Derivatives are held in
units of :math:`\lambda = \sqrt{2 \nu} / \ell`, which keeps every entry of order one.
"""

import numpy as np
from jaxtyping import Float

SMOOTHNESSES = (0.5, 1.5, 2.5)


def per_member(parameter: np.ndarray | float) -> np.ndarray:
    """Parameter of each member of a family, with axes for the matrices of its state."""
    return np.asarray(parameter)[..., None, None]


def rate(smoothness: float, length: np.ndarray | float) -> np.ndarray:
    r"""Rate :math:`\lambda = \sqrt{2 \nu} / \ell` at which a Matérn process forgets.

    Parameters
    ----------
    smoothness
        Smoothness: 0.5, 1.5 or 2.5 [1].
    length
        Length scale, in the unit of time.

    Returns
    -------
    Rate [1 / unit of time], of the shape of `length`.
    """
    return np.asarray(np.sqrt(2.0 * smoothness) / length)


def stationary(smoothness: float) -> Float[np.ndarray, "state state"]:
    """Stationary covariance of the state of a Matérn process of unit variance [1].

    Parameters
    ----------
    smoothness
        Smoothness: 0.5, 1.5 or 2.5 [1].
    """
    if smoothness == 0.5:
        return np.ones((1, 1))
    if smoothness == 1.5:
        return np.eye(2)
    third = 1.0 / 3.0
    return np.array([[1.0, 0.0, -third], [0.0, third, 0.0], [-third, 0.0, 1.0]])


def matern_transition(
    smoothness: float, s: Float[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch state state"]:
    r"""Transition of the state of a Matérn process over a time [1].

    The generator has the one eigenvalue -1, so its exponential is :math:`e^{-s}` times a
    polynomial of degree `smoothness` - 1/2.

    Parameters
    ----------
    smoothness
        Smoothness: 0.5, 1.5 or 2.5 [1].
    s
        Time, in units of :math:`1 / \lambda` [1].
    """
    entries = [[np.ones_like(s)]] if smoothness == 0.5 else _polynomials(smoothness, s)
    rows = [np.stack(row, axis=-1) for row in entries]
    decayed: Float[np.ndarray, "*batch state state"] = (
        np.stack(rows, axis=-2) * np.exp(-s)[..., None, None]
    )
    return decayed


def _polynomials(smoothness: float, s: np.ndarray) -> list[list[np.ndarray]]:
    """Entries of a transition without their common factor, of the smoothness 1.5 or 2.5."""
    if smoothness == 1.5:
        return [[1.0 + s, s], [-s, 1.0 - s]]
    half = 0.5 * s**2
    return [
        [1.0 + s + half, s + s**2, half],
        [-half, 1.0 + s - s**2, s - half],
        [half - s, s**2 - 3.0 * s, 1.0 - 2.0 * s + half],
    ]


def trend_noise(step: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch 2 2"]:
    """Covariance that white noise of unit density in the slope adds to level and slope.

    Parameters
    ----------
    step
        Time steps, in the unit of time.

    Returns
    -------
    Covariances.
    """
    rows = [
        np.stack([step**3 / 3.0, step**2 / 2.0], axis=-1),
        np.stack([step**2 / 2.0, step], axis=-1),
    ]
    return np.stack(rows, axis=-2)

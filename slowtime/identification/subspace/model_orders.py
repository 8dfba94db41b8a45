"""Poles of models of every order from one subspace, with first-order errors.

The errors are those of the weighted matrix whose singular vectors span the subspace; see
`slowtime.identification.subspace.ssi` for the formula.
"""

import dataclasses

import numpy as np
import scipy.linalg

from .poles import Poles, rescale_channels

RIDGE = 1e-6
"""Least eigenvalue of a whitened covariance, relative to the mean power [1]; below is
rounding."""


@dataclasses.dataclass(frozen=True, slots=True)
class Whitening:
    """Inverse square root of a covariance, which multiplies from the left, and its inverse."""

    left: np.ndarray
    inverse: np.ndarray


@dataclasses.dataclass(frozen=True, slots=True)
class WeightedSubspace:
    """Left singular vectors of the weighted Hankel matrix, and what its draws move them by.

    `errors` are each draw of the weighted matrix times right singular vectors over singular
    values; `unweighted` leads from the weighted future to the future.
    """

    u: np.ndarray
    gamma: np.ndarray
    errors: np.ndarray
    unweighted: np.ndarray
    channels: int
    rate_hz: float


def whitening(covariance: np.ndarray | None, size: int, dtype: np.dtype) -> Whitening:
    """Whiten by the inverse square root of a Hermitian covariance; None for the identity."""
    if covariance is None:
        identity = np.eye(size, dtype=dtype)
        return Whitening(identity, identity)
    power, directions = scipy.linalg.eigh((covariance + covariance.conj().T) / 2)
    root = np.sqrt(np.maximum(power, 0.0) + RIDGE * np.trace(covariance).real / size)
    turned = directions.conj().T
    return Whitening((directions / root) @ turned, (directions * root) @ turned)


PolesOfOrder = tuple[int, np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]


def poles_of_order(
    subspace: WeightedSubspace, n: int, centre_hz: float, shapes: bool
) -> PolesOfOrder:
    """Poles of positive frequency of one order, with what the draws move them by.

    Errors of the shapes are None unless they are asked for.
    """
    channels, rate = subspace.channels, subspace.rate_hz
    gamma = subspace.gamma[:, :n]
    inverse = np.linalg.pinv(gamma[:-channels])
    eigenvalue, right = np.linalg.eig(inverse @ gamma[channels:])
    keep = eigenvalue != 0
    observed = np.linalg.solve(right, inverse.astype(right.dtype))
    pole = np.zeros_like(eigenvalue, dtype=complex)
    pole[keep] = np.log(eigenvalue[keep].astype(complex)) * rate
    pole += 2j * np.pi * centre_hz
    keep &= pole.imag > 0
    at = np.flatnonzero(keep)
    # Row functionals on the error of the observability matrix, one for each eigenvector m.
    down, up = np.zeros((2, len(observed), len(gamma)), dtype=complex)
    down[:, channels:], up[:, :-channels] = observed, observed
    own = down[at] - eigenvalue[at, None] * up[at]
    shape = gamma[:channels] @ right
    rows = own[:, None]
    if shapes:
        gap = eigenvalue[at, None] - eigenvalue
        share = np.where(gap == 0, 0.0, 1.0 / np.where(gap == 0, 1.0, gap))
        mixed = shape * share[:, None]
        others = _times(mixed, down) - eigenvalue[at, None, None] * _times(mixed, up)
        rows = np.concatenate([rows, others + np.eye(channels, len(gamma))], axis=1)
    moved = _functionals(subspace, n, rows, right[:, at])
    size = np.linalg.norm(shape[:, at], axis=0)
    derivative = rate / eigenvalue[at]
    moves = moved[:, 1:] / size if shapes else None
    return n, pole[at], shape[:, at] / size, moved[:, 0] * derivative, moves


def _functionals(
    subspace: WeightedSubspace, n: int, rows: np.ndarray, right: np.ndarray
) -> np.ndarray:
    """Rows times the error of the observability matrix times an eigenvector."""
    u = subspace.u[:, :n]
    x = _times(rows, subspace.unweighted)
    x = x - _times(_times(x, u), u.conj().T)
    moved = _times(subspace.errors[:, :, :n], right)
    moves = x @ np.ascontiguousarray(moved.transpose(2, 1, 0))
    return np.asarray(moves.transpose(2, 1, 0))


def _times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Product of a stack of matrices and a matrix, a real one of them left real."""
    flat = np.ascontiguousarray(a).reshape(-1, a.shape[-1])
    if np.iscomplexobj(b) and not np.iscomplexobj(a):
        made = (flat @ np.ascontiguousarray(b).view(float)).view(complex)
    elif np.iscomplexobj(a) and not np.iscomplexobj(b):
        parts = np.concatenate([flat.real, flat.imag]) @ b
        made = parts[: len(flat)] + 1j * parts[len(flat) :]
    else:
        made = flat @ b
    return np.asarray(made.reshape(*a.shape[:-1], b.shape[-1]))


def joined_poles(parts: list[PolesOfOrder], duration_s: float) -> Poles:
    """Join the poles of all orders."""
    order = np.concatenate([np.full(len(part[1]), part[0]) for part in parts])
    errors = [part[4] for part in parts if part[4] is not None]
    found = Poles(
        order=order,
        pole=np.concatenate([part[1] for part in parts]),
        shape=np.concatenate([part[2] for part in parts], axis=1),
        draws=np.concatenate([part[3] for part in parts], axis=1),
        shape_draws=np.concatenate(errors, axis=2) if len(errors) == len(parts) else None,
        duration_s=duration_s,
    )
    return rescale_channels(found, np.ones(len(found.shape)))

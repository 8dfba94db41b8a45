r"""Propagators of a linear system over a step and its halves.

With a force that is a polynomial over the step, :math:`u(\tau) = \sum_j a_j (\tau / T)^j`,

.. math:: x(T) = \Phi x(0) + \sum_j \Psi_j a_j, \qquad
    \Psi_j(T) = \int_0^T e^{A (T - \tau)} B (\tau / T)^j \, d\tau .

Both come as Taylor series over a step so short that they converge, and are then doubled:

.. math:: \Phi(2T) = \Phi^2, \qquad
    \Psi_j(2T) = 2^{-j} \Big( \Phi \Psi_j + \sum_{k \le j} \binom{j}{k} \Psi_k \Big) .

Slopes to parameters follow by the product rule. Scaling and squaring: Moler and Van Loan 2003.
"""

import dataclasses
import functools
import math

import numpy as np
from jaxtyping import Float

from .kernel import RADAU

LEVELS = 7
"""How often a sample interval can be halved, at least."""
REACH = 0.25
"""Fastest pole times the shortest step, at most."""
TERMS = 14
"""Of Taylor's series: what is left out is below 1e-16 there."""

Stack = Float[np.ndarray, "slope _ _"]
"""A matrix first, then its slope to each linear parameter."""
Joined = Float[np.ndarray, "3 slope state _"]
"""What is kept of the state, then what each power of each force pushes, side by side."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Steps:
    r"""Matrices of steps of several lengths at three fractions of each, the last the whole.

    Parameters
    ----------
    kept
        :math:`\Phi`, over (step, fraction, slope, state, state).
    pushed
        :math:`\Psi_j`, over (step, fraction, slope, state, power, column of B).
    """

    kept: Float[np.ndarray, "step 3 slope state state"]
    pushed: Float[np.ndarray, "step 3 slope state power column"]


def levels_of(a: Stack, b: Stack, interval: float, powers: int, *, deep: bool) -> Steps:
    r"""Compute the propagators over a sample interval and, if `deep`, over its half and so on.

    Matrices are those of :math:`\dot x = A x + B u`, then their slopes. With `deep`, the
    interval is halved as often as events need.
    """
    fastest = float(np.abs(np.linalg.eigvals(a[0])).max(initial=0.0))
    needed = max(0, math.ceil(math.log2(max(fastest * interval / REACH, 1.0))))
    count = max(needed, LEVELS) if deep else needed
    found = [_shortest(a, b, interval / 2**count, powers)]
    doubling = _doubling(powers, b.shape[2])
    for _ in range(count):
        found.append(_doubled(found[-1], len(a[0]), *doubling))
    levels = np.stack(found[::-1] if deep else found[-1:])
    states = a.shape[1]
    pushed = levels[..., states:].reshape(*levels.shape[:-1], powers, b.shape[2])
    return Steps(levels[..., :states], pushed)


def product(
    first: Float[np.ndarray, "*_a slope _ _"], second: Float[np.ndarray, "*_b slope _ _"]
) -> Float[np.ndarray, "*_c slope _ _"]:
    """Multiply two matrices, and their slopes by the product rule.

    Leading axes are broadcast.
    """
    found = first[..., :1, :, :] @ second
    found[..., 1:, :, :] += first[..., 1:, :, :] @ second[..., :1, :, :]
    return np.asarray(found)


def _shortest(a: Stack, b: Stack, step: float, powers: int) -> Joined:
    states = a.shape[1]
    power = np.zeros((*a.shape[:2], states + b.shape[2]))
    power[0, :, :states], power[:, :, states:] = np.eye(states), b
    terms = [power]
    for _ in range(1, TERMS):
        terms.append(product(a, terms[-1]))
    every, lengths = np.array(terms), step * np.array(RADAU)[:, None]
    of_state, of_force = _taylor(powers)
    kept = np.tensordot(lengths ** np.arange(TERMS) * of_state, every[..., :states], 1)
    shares = lengths ** np.arange(1, TERMS + 1) * of_force[:, None]
    pushed = np.tensordot(shares, every[..., states:], 1)
    joined = np.moveaxis(pushed, 0, 3).reshape(*kept.shape[:3], -1)
    return np.concatenate([kept, joined], axis=3)


def _doubled(
    half: Joined,
    states: int,
    later: Float[np.ndarray, "pushed pushed"],
    sooner: Float[np.ndarray, " pushed"],
) -> Joined:
    found = product(half[..., :states], half)
    found[..., states:] *= sooner
    found[..., states:] += half[..., states:] @ later
    return found


@functools.cache
def _taylor(
    powers: int,
) -> tuple[Float[np.ndarray, " term"], Float[np.ndarray, "power term"]]:
    """Factors of Taylor's series of what is kept, and of what each power pushes."""
    kept = [1 / math.factorial(i) for i in range(TERMS)]
    pushed = [
        [math.factorial(j) / math.factorial(i + j + 1) for i in range(TERMS)]
        for j in range(powers)
    ]
    return np.array(kept), np.array(pushed)


@functools.cache
def _doubling(
    powers: int, columns: int
) -> tuple[Float[np.ndarray, "pushed pushed"], Float[np.ndarray, " pushed"]]:
    """Give what the second half of a step takes of each power over the first; and the first."""
    rows = [[math.comb(j, k) / 2**j for j in range(powers)] for k in range(powers)]
    sooner = np.repeat(0.5 ** np.arange(powers), columns)
    return np.kron(np.array(rows), np.eye(columns)), sooner

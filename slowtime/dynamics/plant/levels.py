r"""A linear system in; what it does over a step, over its half, over its half's half ... out.

With a force that is a polynomial over the step, :math:`u(\tau) = \sum_j a_j (\tau / T)^j`,

.. math:: x(T) = \Phi x(0) + \sum_j \Psi_j a_j, \qquad
    \Psi_j(T) = \int_0^T e^{A (T - \tau)} B (\tau / T)^j \, d\tau .

Both come as Taylor series over a step so short that they converge, and are then doubled:

.. math:: \Phi(2T) = \Phi^2, \qquad
    \Psi_j(2T) = 2^{-j} \Big( \Phi \Psi_j + \sum_{k \le j} \binom{j}{k} \Psi_k \Big) .

Slopes to parameters follow by the product rule. Scaling and squaring: Moler and Van Loan 2003.
"""

import dataclasses
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


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Steps:
    r"""Matrices of one step length at three fractions of it, the last the whole.

    Parameters
    ----------
    kept
        :math:`\Phi`, over (fraction, slope, state, state).
    pushed
        :math:`\Psi_j`, over (power, fraction, slope, state, column of B).
    """

    kept: Float[np.ndarray, "3 slope state state"]
    pushed: Float[np.ndarray, "power 3 slope state column"]


def levels_of(a: Stack, b: Stack, interval: float, powers: int, *, deep: bool) -> list[Steps]:
    r"""Make steps of a sample interval [s], its half and so on: `deep`, as events need, or one.

    Parameters
    ----------
    a, b
        Matrices of :math:`\dot x = A x + B u`, then their slopes.
    powers
        Of the polynomials, from 0.
    """
    fastest = float(np.abs(np.linalg.eigvals(a[0])).max(initial=0.0))
    needed = max(0, math.ceil(math.log2(max(fastest * interval / REACH, 1.0))))
    count = max(needed, LEVELS) if deep else needed
    found = [_shortest(a, b, interval / 2**count, powers)]
    for _ in range(count):
        found.append(_doubled(found[-1]))
    return found[::-1] if deep else found[-1:]


def product(
    first: Float[np.ndarray, "*_a slope _ _"], second: Float[np.ndarray, "*_b slope _ _"]
) -> Float[np.ndarray, "*_c slope _ _"]:
    """Multiply two matrices, and their slopes by the product rule; leading axes alike."""
    found = first[..., :1, :, :] @ second
    found[..., 1:, :, :] += first[..., 1:, :, :] @ second[..., :1, :, :]
    return np.asarray(found)


def _shortest(a: Stack, b: Stack, step: float, powers: int) -> Steps:
    lengths = step * np.array(RADAU)[:, None, None, None]
    one = np.zeros_like(a)
    one[0] = np.eye(a.shape[1])
    kept, pushed = np.zeros((3, *a.shape)), np.zeros((powers, 3, *b.shape))
    power, forced = one, b
    for i in range(TERMS):
        kept += lengths**i / math.factorial(i) * power
        for j in range(powers):
            share = math.factorial(j) / math.factorial(i + j + 1)
            pushed[j] += lengths ** (i + 1) * share * forced
        power, forced = product(a, power), product(a, forced)
    return Steps(kept, pushed)


def _doubled(half: Steps) -> Steps:
    powers = len(half.pushed)
    pushed = np.empty_like(half.pushed)
    for j in range(powers):
        later = sum(math.comb(j, k) * half.pushed[k] for k in range(j + 1))
        pushed[j] = (product(half.kept, half.pushed[j]) + later) / 2**j
    return Steps(product(half.kept, half.kept), pushed)

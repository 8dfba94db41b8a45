r"""Mean densities of blocks of lines in, the likeliest colour of one family out: compiled.

Fisher's scoring, damped where it overshoots: with the density :math:`N(\theta)` of blocks that
count :math:`c_k`, the slopes of the likelihood and the information are

.. math:: g = \sum_k c_k \, (m_k / N_k - 1) \, \partial \log N_k , \qquad
          F = \sum_k c_k \, \partial \log N_k \, \partial \log N_k^T .

Numbers are: logarithms of both strengths; of the corner, and the slope; or, of a hump, of the
odds of its radius, and its angle.
"""

import math
from typing import Any

import numpy as np

from slowtime.dynamics.effects.compilation import compiled

FALLING, HUMPED = 0, 1
WIDEST = 0.95
"""Radius of the poles of the sharpest hump that may still pass for noise."""
MOST_STEPS, LONGEST, ENOUGH = 60, 2.0, 1e-3
"""Steps of a climb, the longest of them, and the gain of log likelihood that ends it."""
NUMBERS = 4

Reals = np.ndarray[Any, np.dtype[np.float64]]


def climbed(
    blocks: Reals, at: Reals, low: Reals, high: Reals, family: int, rate_hz: float
) -> Reals:
    """Climb from numbers to those of greatest likelihood.

    Parameters
    ----------
    blocks
        By row: frequency, mean density, lines, and the logarithms of the probabilities that a
        block is noise alone, and that it is not.
    low, high
        Bounds of the numbers.
    """
    found = np.clip(at, low, high).astype(float)
    room = np.zeros((3, NUMBERS, NUMBERS + 2))
    _climb(np.ascontiguousarray(blocks), found, low, high, family, rate_hz, room)
    return found


@compiled
def _climb(
    blocks: Reals,
    at: Reals,
    low: Reals,
    high: Reals,
    family: int,
    rate_hz: float,
    room: Reals,
) -> None:
    """Climb in place; `room` holds slopes and information here and there, and a system."""
    here, there, inner = room[0], room[1], room[2]
    total = _scored(blocks, at, family, rate_hz, here)
    damping = 1e-3
    for _ in range(MOST_STEPS):
        for i in range(NUMBERS):
            held = (at[i] <= low[i] and here[i, NUMBERS] < 0) or (
                at[i] >= high[i] and here[i, NUMBERS] > 0
            )
            for j in range(NUMBERS + 1):
                inner[i, j] = 0.0 if held else here[i, j]
            inner[i, i] += damping * inner[i, i] + 1e-9
            if held:
                inner[i, i] = 1.0
        _solve(inner)
        for i in range(NUMBERS):
            inner[i, NUMBERS + 1] = at[i]
            step = min(max(inner[i, NUMBERS], -LONGEST), LONGEST)
            at[i] = min(max(at[i] + step, low[i]), high[i])
        tried = _scored(blocks, at, family, rate_hz, there)
        gain = tried - total
        if gain > 0:
            total = tried
            here, there = there, here
            damping /= 10.0
        else:
            for i in range(NUMBERS):
                at[i] = inner[i, NUMBERS + 1]
            damping = max(10.0 * damping, 1e-2)
        if abs(gain) < ENOUGH or damping > 1e6:
            return


@compiled
def _solve(system: Reals) -> None:
    """Solve a positive system in place: rows of the matrix, then the right side."""
    for k in range(NUMBERS):
        for i in range(k + 1, NUMBERS):
            share = system[i, k] / system[k, k]
            for j in range(k, NUMBERS + 1):
                system[i, j] -= share * system[k, j]
    for k in range(NUMBERS - 1, -1, -1):
        for j in range(k + 1, NUMBERS):
            system[k, NUMBERS] -= system[k, j] * system[j, NUMBERS]
        system[k, NUMBERS] /= system[k, k]


@compiled
def _scored(blocks: Reals, at: Reals, family: int, rate_hz: float, found: Reals) -> float:
    """Log likelihood; put the information and, in the next column, the slopes."""
    for i in range(NUMBERS):
        for j in range(NUMBERS + 1):
            found[i, j] = 0.0
    white, low, total = math.exp(at[0]), math.exp(at[1]), 0.0
    third, last = 0.0, 0.0
    radius = WIDEST / (1.0 + math.exp(-at[2]))
    corner = math.exp(at[2])
    for b in range(blocks.shape[1]):
        frequency, power, lines = blocks[0, b], blocks[1, b], blocks[2, b]
        if family == FALLING:
            square = (frequency / corner) ** 2
            ratio = math.log1p(square)
            part = low * math.exp(-at[3] / 2.0 * ratio)
            third, last = at[3] * square / (1.0 + square), -ratio / 2.0
        else:
            turn = 2.0 * math.pi * frequency / rate_hz
            one = 1.0 - 2.0 * radius * math.cos(turn - at[3]) + radius**2
            two = 1.0 - 2.0 * radius * math.cos(turn + at[3]) + radius**2
            part = low / (one * two)
            by_radius = (math.cos(turn - at[3]) - radius) / one
            by_radius += (math.cos(turn + at[3]) - radius) / two
            third = 2.0 * by_radius * radius * (1.0 - radius / WIDEST)
            last = math.sin(turn - at[3]) / one - math.sin(turn + at[3]) / two
            last *= 2.0 * radius
        density = white + part
        more = max(density, power)
        clean = blocks[3, b] - lines * (math.log(density) + power / density)
        above = blocks[4, b] - lines * (math.log(more) + power / more)
        most = max(clean, above)
        both = most + math.log(math.exp(clean - most) + math.exp(above - most))
        total += both
        alone = math.exp(clean - both)
        # A block that holds more than noise does not care how much less the noise is.
        counts = lines * (alone if density <= power else 1.0)
        share = part / density
        slopes = (white / density, share, third * share, last * share)
        for i in range(NUMBERS):
            for j in range(NUMBERS):
                found[i, j] += counts * slopes[i] * slopes[j]
            found[i, NUMBERS] += counts * (power / density - 1.0) * slopes[i]
    return total

r"""Fisher scoring for the parameters of a noise density, compiled.

Steps are damped where they overshoot. With the density :math:`N(\theta)` of blocks that
count :math:`c_k`, the score and the Fisher information are

.. math:: g = \sum_k c_k \, (m_k / N_k - 1) \, \partial \log N_k , \qquad
          F = \sum_k c_k \, \partial \log N_k \, \partial \log N_k^T .

Parameters are the logarithms of the white and of the coloured part, and: of a power law, the
logarithm of its corner frequency and its slope; of a pair of poles, the log odds of its radius
and its angle.

References
----------
.. [1] P. Whittle, "Gaussian estimation in stationary time series", Bull. Int. Stat. Inst. 39
   (1962), for the likelihood of a periodogram.
"""

import math
from typing import Any

import numpy as np

from slowtime.dynamics.effects.compilation import compiled

POWER_LAW = 0
"""[index] Family of densities with a corner and a slope. Source: none, an enumeration."""
POLE_PAIR = 1
"""[index] Family of densities with a pair of complex poles. Source: none, an enumeration."""
MAX_POLE_RADIUS = 0.95
"""[1] Radius of the poles of the sharpest resonance that may still pass for noise. Source: a
structure's modes have radii above exp(-2 pi zeta f / f_s), well over 0.95 where they are
sampled finely."""
MAX_STEPS = 60
"""[steps] Scoring steps at most. Source: docs/what_decides.md: half and double change no
answer."""
MAX_STEP = 2.0
"""[1] Largest change of any parameter in one step. Source: docs/what_decides.md: half and
double change no answer."""
MIN_GAIN = 1e-3
"""[nats] Gain of log likelihood that ends the iteration. Source: a thousandth of what one
standard deviation is worth (1/2)."""
PARAMETERS = 4
"""[1] Parameters of either family. Source: two strengths and two of shape."""

Reals = np.ndarray[Any, np.dtype[np.float64]]


def maximise_likelihood(
    blocks: Reals, at: Reals, low: Reals, high: Reals, family: int, rate_hz: float
) -> Reals:
    """Maximise the likelihood of block means within bounds.

    Rows of `blocks` are frequency [Hz], mean density [unit²/Hz], lines, and the logarithms of
    the probabilities that a block is noise alone, and that it is not.
    """
    found = np.clip(at, low, high).astype(float)
    room = np.zeros((3, PARAMETERS, PARAMETERS + 2))
    _fisher_scoring(np.ascontiguousarray(blocks), found, low, high, family, rate_hz, room)
    return found


@compiled
def _fisher_scoring(
    blocks: Reals,
    at: Reals,
    low: Reals,
    high: Reals,
    family: int,
    rate_hz: float,
    room: Reals,
) -> None:
    """Iterate in place; `room` holds score and information at two points, and a system."""
    here, there, inner = room[0], room[1], room[2]
    total = _likelihood_and_information(blocks, at, family, rate_hz, here)
    damping = 1e-3
    for _ in range(MAX_STEPS):
        for i in range(PARAMETERS):
            held = (at[i] <= low[i] and here[i, PARAMETERS] < 0) or (
                at[i] >= high[i] and here[i, PARAMETERS] > 0
            )
            for j in range(PARAMETERS + 1):
                inner[i, j] = 0.0 if held else here[i, j]
            inner[i, i] += damping * inner[i, i] + 1e-9
            if held:
                inner[i, i] = 1.0
        _solve(inner)
        for i in range(PARAMETERS):
            inner[i, PARAMETERS + 1] = at[i]
            step = min(max(inner[i, PARAMETERS], -MAX_STEP), MAX_STEP)
            at[i] = min(max(at[i] + step, low[i]), high[i])
        tried = _likelihood_and_information(blocks, at, family, rate_hz, there)
        gain = tried - total
        if gain > 0:
            total = tried
            here, there = there, here
            damping /= 10.0
        else:
            for i in range(PARAMETERS):
                at[i] = inner[i, PARAMETERS + 1]
            damping = max(10.0 * damping, 1e-2)
        if abs(gain) < MIN_GAIN or damping > 1e6:
            return


@compiled
def _solve(system: Reals) -> None:
    """Solve a positive system in place: rows of the matrix, then the right side."""
    for k in range(PARAMETERS):
        for i in range(k + 1, PARAMETERS):
            share = system[i, k] / system[k, k]
            for j in range(k, PARAMETERS + 1):
                system[i, j] -= share * system[k, j]
    for k in range(PARAMETERS - 1, -1, -1):
        for j in range(k + 1, PARAMETERS):
            system[k, PARAMETERS] -= system[k, j] * system[j, PARAMETERS]
        system[k, PARAMETERS] /= system[k, k]


@compiled
def _likelihood_and_information(
    blocks: Reals, at: Reals, family: int, rate_hz: float, found: Reals
) -> float:
    """Log likelihood; fills `found` with the information and, in the next column, the score."""
    for i in range(PARAMETERS):
        for j in range(PARAMETERS + 1):
            found[i, j] = 0.0
    white, low, total = math.exp(at[0]), math.exp(at[1]), 0.0
    third, last = 0.0, 0.0
    radius = MAX_POLE_RADIUS / (1.0 + math.exp(-at[2]))
    corner = math.exp(at[2])
    for b in range(blocks.shape[1]):
        frequency, power, lines = blocks[0, b], blocks[1, b], blocks[2, b]
        if family == POWER_LAW:
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
            third = 2.0 * by_radius * radius * (1.0 - radius / MAX_POLE_RADIUS)
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
        for i in range(PARAMETERS):
            for j in range(PARAMETERS):
                found[i, j] += counts * slopes[i] * slopes[j]
            found[i, PARAMETERS] += counts * (power / density - 1.0) * slopes[i]
    return total

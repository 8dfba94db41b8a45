r"""Candidates from sharp peaks of frequency responses, which models of all lines pass over.

A resonance a line or two wide weighs little among thousands of lines. Near its peak alone, all
pairs of output and input share one pole,

.. math:: (s - \lambda) H_e(s) = b_{e0} + b_{e1} s + b_{e2} s^2 ,

which is linear in :math:`\lambda` once the polynomials are projected out; weights
:math:`1 / |s - \lambda|` of the step before make equation errors those of H (Sanathanan and
Koerner, IEEE Trans. Automatic Control 8, 1963).
"""

import numpy as np
import scipy.ndimage
from jaxtyping import Complex, Float

from slowtime.identification.frequency_response.response import FrequencyResponse
from slowtime.identification.subspace.stabilisation import StablePole
from slowtime.signals.peaks import local_maxima

SURROUNDINGS = 25
"""[lines] On either side, whose median is what a peak stands out of. Source: a peak of five
lines hardly lifts it."""
STANDS_OUT = 8.0
"""[1] Power of a peak over that median. Source: of noise in three pairs, one line in ten
million."""
MOST_PEAKS = 40
"""[1] Candidates at most, the strongest. Source: as many as orders of pLSCF."""
NEAR_LINES = 6
"""[lines] On either side that the pole is fitted to. Source: four numbers of a pair, thrice."""
ITERATIONS = 6
"""Weighted solutions; the pole then moves by less than its error."""
APART = 2.0
"""[half-bandwidths, or lines] From a candidate within which a peak is its own. Source: pLSCF
of thousands of lines is off by one; a second pole there would be left over."""
LEAST_WIDTH = 0.05
"""[lines] Half-bandwidth of a pole at least. Source: what a fit of values to 1 % tells."""


def peak_candidates(response: FrequencyResponse, known: list[StablePole]) -> list[StablePole]:
    """Poles at sharp peaks that no candidate stands for.

    Their share is that of the peak above its surroundings, in place of a share of orders.
    """
    lines = len(response.frequency_hz)
    values = response.response.reshape(lines, -1)
    usual = np.median(response.sd.reshape(lines, -1), axis=0)
    power = np.sum(np.abs(values / np.where(usual > 0, usual, 1.0)) ** 2, axis=1)
    around = scipy.ndimage.median_filter(power, 2 * SURROUNDINGS + 1, mode="nearest")
    peaks = local_maxima(power)
    peaks = peaks[power[peaks] > STANDS_OUT * around[peaks]]
    strongest = peaks[np.argsort(-power[peaks])][:MOST_PEAKS]
    spacing = float(2 * np.pi * np.median(np.diff(response.frequency_hz)))
    found: list[StablePole] = []
    for peak in sorted(int(one) for one in strongest):
        near = slice(max(peak - NEAR_LINES, 0), peak + NEAR_LINES + 1)
        start = response.s[peak] - spacing / 2
        pole, shape = local_pole(response.s[near], values[near], start, spacing)
        pole += response.decay_rate
        others = [(one.pole, max(-one.pole.real, spacing)) for one in (*known, *found)]
        if all(abs(one - pole) > APART * max(width, -pole.real) for one, width in others):
            share = float(1.0 - around[peak] / power[peak])
            whole = shape.reshape(response.response.shape[1:])
            found.append(_candidate(pole, whole, share))
    return found


def local_pole(
    s: Complex[np.ndarray, " line"],
    values: Complex[np.ndarray, "line pair"],
    start: complex,
    spacing: float,
) -> tuple[complex, Complex[np.ndarray, " pair"]]:
    """Fit the one pole that all pairs share over a few lines.

    The start is kept where the fit leaves the lines.
    """
    centre, pole = start.imag, start
    x = (s - 1j * centre) / spacing
    for _ in range(ITERATIONS):
        weight = 1.0 / np.abs(s - pole)
        smooth, _ = np.linalg.qr(weight[:, None] * x[:, None] ** np.arange(3))
        left = weight[:, None] * values
        moved = x[:, None] * left
        left = left - smooth @ (smooth.conj().T @ left)
        moved = moved - smooth @ (smooth.conj().T @ moved)
        size = float(np.sum(np.abs(left) ** 2))
        if not size > 0:
            break
        found = 1j * centre + spacing * complex(np.sum(left.conj() * moved) / size)
        offset = abs(found.imag - centre) / spacing
        if not (offset < NEAR_LINES / 2 and found.real < start.real + 0.5 * spacing):
            pole = start
            break
        pole = complex(min(found.real, -LEAST_WIDTH * spacing), found.imag)
    basis = np.column_stack([1.0 / (s - pole), x**0, x])
    return pole, np.linalg.lstsq(basis, values, rcond=None)[0][0]


def _candidate(
    pole: complex, residues: Complex[np.ndarray, "output input"], share: float
) -> StablePole:
    strongest = int(np.argmax(np.abs(residues).sum(axis=0)))
    shape = residues[:, strongest]
    nothing: Float[np.ndarray, " none"] = np.zeros(0)
    return StablePole(
        pole=pole,
        shape=shape / max(float(np.linalg.norm(shape)), 1e-300),
        frequency_sd_hz=0.0,
        damping_sd=0.0,
        orders=1,
        share=share,
        members=nothing.astype(int),
        index=0,
    )

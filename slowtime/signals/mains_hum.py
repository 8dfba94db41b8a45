"""Lines of the mains in a channel: 50 or 60 Hz and multiples, steady and narrow."""

import dataclasses

import numpy as np
import scipy.fft as fft
from jaxtyping import Float

MAINS_HZ = (50.0, 60.0)
"""[Hz] Nominal frequencies of public grids."""
GRID_TOLERANCE = 0.004
"""[1] Relative deviation of the mains from nominal. Source: EN 50160, 1 % in 99.5 % of a year
and in practice 0.2 Hz; what is wider may be an asynchronous motor."""
SEGMENT_S = 4.0
"""[s] Segments whose power is compared: lines of 0.5 Hz are told from others."""
FEWEST_SEGMENTS = 8
"""[1] Segments from which on steadiness is told: of a random response, powers of so many vary
by a relative deviation of 1 ± 0.35."""
STEADY = 0.3
"""[1] Largest relative deviation of the powers of segments of a line that a grid feeds."""
LINE_OVER_FLOOR = 30.0
"""[1] Power of a line over that of as many lines beside it, at least. Source: 15 dB."""
SHARE = 0.01
"""[share of the variance] From which hum is told. Source: judgement; a line of less bears on no
mode that does not lie on it."""
_REACH, _BESIDE = 2, 8
"""[lines] Half-width of a line behind a Hann window, and of what is beside it."""


@dataclasses.dataclass(frozen=True, slots=True)
class Hum:
    """Nominal frequency [Hz], the lines found [Hz], and their share of the variance [1]."""

    mains_hz: float
    lines_hz: tuple[float, ...]
    share: float


def find_hum(samples: Float[np.ndarray, " time"], rate_hz: float) -> Hum | None:
    """Find the hum of the mains in a channel, aliased lines too.

    Parameters
    ----------
    samples
        Finite, in any unit.

    Returns
    -------
    The hum; None where it has less than a hundredth of the variance, or the record is too
    short to tell a line from a resonance.
    """
    size = round(SEGMENT_S * rate_hz)
    count = len(samples) // size if size else 0
    if count < FEWEST_SEGMENTS or size <= 4 * _BESIDE:
        return None
    parts = samples[: count * size].reshape(count, size)
    parts = (parts - parts.mean()) * np.hanning(size)
    power = np.abs(fft.rfft(parts, axis=1)) ** 2
    total = float(power[:, 1:].sum())
    found = [
        Hum(mains, lines, share)
        for mains in MAINS_HZ
        for lines, share in [_lines(power, total, mains, rate_hz)]
        if share >= SHARE
    ]
    return max(found, key=lambda hum: hum.share, default=None)


def _lines(
    power: Float[np.ndarray, "segment line"], total: float, mains_hz: float, rate_hz: float
) -> tuple[tuple[float, ...], float]:
    """Lines at the mains' frequency and its multiples, folded at half the rate."""
    spacing = rate_hz / (2 * (power.shape[1] - 1))
    lines: list[float] = []
    share = 0.0
    for multiple in range(1, 6):
        nominal = multiple * mains_hz
        folded = abs(nominal - rate_hz * round(nominal / rate_hz))
        reach = max(GRID_TOLERANCE * nominal, spacing)
        first, last = (round((folded + side * reach) / spacing) for side in (-1, 1))
        if first < _BESIDE or last + _BESIDE >= power.shape[1]:
            continue
        peak = first + int(np.argmax(power[:, first : last + 1].sum(axis=0)))
        line = power[:, peak - _REACH : peak + _REACH + 1].sum(axis=1)
        around = power[:, peak - _BESIDE : peak + _BESIDE + 1].sum(axis=1) - line
        floor = around.mean() * (2 * _REACH + 1) / (2 * (_BESIDE - _REACH))
        steady = line.std() < STEADY * line.mean()
        if steady and line.mean() > LINE_OVER_FLOOR * floor:
            lines.append(peak * spacing)
            share += float(line.sum()) / total
    return tuple(lines), share

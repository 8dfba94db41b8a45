"""Samples in, the resonances that stand significantly above their neighbourhood out."""

import dataclasses
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.special import gammainccinv

from slowtime.signals.peaks import local_maxima
from slowtime.signals.spectra import noise_floor, periodogram, smoothed

FALSE_ALARM = 1e-3
"""Probability that a record of stationary noise shows a candidate at all."""

SMOOTHING = 0.01
"""Half-width, relative to frequency, over which ordinates are averaged for peaks to be read."""

HANN_WORTH = 1.94
"""Hann correlates neighbours: so many ordinates carry the information of one."""

VALLEY_DB = 6.0
"""Two peaks are two modes if the valley between them is this deep, beyond its scatter."""

COMPANION_DB = 8.0
COMPANION_DB_PER_OCTAVE = 32.0
"""A peak is another's companion, its side lobe or lesser close mode, if it is weaker by so
much within a quarter octave, and by so much more an octave further away."""

SKIRT, SKIRT_FROM = 0.5, 0.08
"""A mode's skirt reaches as far as e to the first of its frequency, outside of its peak."""

RESOLVED_BINS = 8.0
UNRESOLVED_DB = 3.0
"""Closer than so many bins, being weaker by this is enough."""


@dataclasses.dataclass(frozen=True, slots=True)
class Candidate:
    """A peak, the band that is its own, and how far it stands above the floor."""

    frequency_hz: float
    low_hz: float
    high_hz: float
    prominence_db: float


@dataclasses.dataclass(frozen=True, slots=True)
class _Curve:
    """Mean over channels of density over floor, smoothed, and what its ordinates are worth."""

    frequency_hz: Float[np.ndarray, " frequency"]
    level_db: Float[np.ndarray, " frequency"]
    worth: Float[np.ndarray, " frequency"]


def candidates(
    columns: Float[np.ndarray, "time channel"],
    rate_hz: float,
    low: float,
    high: float,
    *,
    taper: str = "hann",
) -> list[Candidate]:
    """Significant peaks between `low` and `high`, ascending in frequency.

    Every channel's Hann periodogram is divided by its own floor; the mean over channels of n
    ordinates exceeds the quantile of a gamma law with probability `FALSE_ALARM` over the whole
    spectrum. What is weak beside a close, stronger peak is left to that one's fit.
    """
    curve = _curve(columns, rate_hz, taper, high)
    inside = (curve.frequency_hz >= low) & (curve.frequency_hz <= high)
    height = np.where(inside, curve.level_db, -np.inf)
    tops = local_maxima(np.maximum(height, -300.0))
    threshold = _threshold_db(curve.worth, int(inside.sum()))
    tops = tops[height[tops] > threshold[tops]]
    separate = _separate(curve, tops[np.argsort(-height[tops])])
    separate = _above_skirts(curve, separate, threshold)
    return _with_bands(curve, separate, low, high)


def strongest(
    columns: Float[np.ndarray, "time channel"],
    rate_hz: float,
    low: float,
    high: float,
    *,
    taper: str = "hann",
) -> Candidate:
    """Peak that stands highest above its floor, significant or not."""
    found = candidates(columns, rate_hz, low, high, taper=taper)
    if found:
        return max(found, key=lambda c: c.prominence_db)
    curve = _curve(columns, rate_hz, taper, high)
    inside = (curve.frequency_hz >= low) & (curve.frequency_hz <= high)
    top = int(np.argmax(np.where(inside, curve.level_db, -np.inf)))
    return Candidate(float(curve.frequency_hz[top]), low, high, float(curve.level_db[top]))


def leading(found: list[Candidate], duration_s: float) -> list[Candidate]:
    """Candidates of a record of `duration_s` without the companions of stronger close ones.

    The band of a companion goes to its nearest stronger neighbour, so that both are fitted
    together.
    """
    lead = [c for c in found if not any(_outshines(other, c, duration_s) for other in found)]
    for companion in found:
        if any(c.frequency_hz == companion.frequency_hz for c in lead):
            continue
        distance = [abs(np.log(c.frequency_hz / companion.frequency_hz)) for c in lead]
        near = int(np.argmin(distance))
        host = lead[near]
        if distance[near] < np.log(2.0):
            lead[near] = dataclasses.replace(
                host,
                low_hz=min(host.low_hz, companion.low_hz),
                high_hz=max(host.high_hz, companion.high_hz),
            )
    return lead


def _outshines(other: Candidate, one: Candidate, duration_s: float) -> bool:
    octaves = abs(float(np.log2(other.frequency_hz / one.frequency_hz)))
    bins = abs(other.frequency_hz - one.frequency_hz) * duration_s
    least = COMPANION_DB if bins > RESOLVED_BINS else UNRESOLVED_DB
    further = COMPANION_DB_PER_OCTAVE * max(octaves - 0.25, 0.0)
    return other.prominence_db - one.prominence_db > least + further


def _curve(columns: np.ndarray, rate_hz: float, taper: str, high: float) -> _Curve:
    spectrum = periodogram(columns, rate_hz, taper=taper)
    # An anti-aliasing filter digs a hole beyond the band, beside which all else seems a peak.
    count = int(np.searchsorted(spectrum.frequency_hz, high, side="right")) + 1
    frequency, density = spectrum.frequency_hz[:count], spectrum.density[:count]
    floor = np.maximum(noise_floor(density), 1e-300)
    ratio = (density / floor).mean(axis=1, keepdims=True)
    level, number = smoothed(ratio, SMOOTHING)
    return _Curve(
        frequency,
        10 * np.log10(np.maximum(level[:, 0], 1e-30)),
        np.maximum(number / HANN_WORTH, 1.0),
    )


def _threshold_db(worth: np.ndarray, bins: int) -> np.ndarray:
    # The floor is estimated from few dozen ordinates where bins are few; hence the factor.
    return np.asarray(10 * np.log10(1.5 * gammainccinv(worth, FALSE_ALARM / bins) / worth))


def _separate(curve: _Curve, tops: np.ndarray) -> list[int]:
    """From the highest down, the peaks with a valley on the way to every higher one."""
    kept: list[int] = []
    for top in tops.tolist():
        need = VALLEY_DB + 2 * 4.34 / np.sqrt(curve.worth[top])
        ceiling = curve.level_db[top] - need
        if all(curve.level_db[min(top, k) : max(top, k)].min() < ceiling for k in kept):
            kept.append(top)
    return sorted(kept)


def _above_skirts(curve: _Curve, tops: list[int], threshold: np.ndarray) -> list[int]:
    r"""From the highest down, the peaks significant above the skirts of the higher ones too.

    Far from its resonance, at :math:`W = f / f_0`, a mode's acceleration under white force has
    the density :math:`c\, W^4 / (1 - W^2)^2`; c is the median of what is there, which lesser
    peaks do not move.
    """
    kept: list[int] = []
    level = 10 ** (curve.level_db / 10)
    background = np.ones_like(level)
    for top in sorted(tops, key=lambda k: -curve.level_db[k]):
        if curve.level_db[top] - 10 * np.log10(background[top]) <= threshold[top]:
            continue
        kept.append(top)
        ratio = curve.frequency_hz / curve.frequency_hz[top]
        near = np.abs(np.log(ratio + 1e-30)) < SKIRT
        shape = np.where(near, ratio**4 / np.maximum((1 - ratio**2) ** 2, 1e-3), 0.0)
        skirt = near & (np.abs(ratio - 1) > SKIRT_FROM)
        if skirt.any():
            excess = np.maximum(level[skirt] - background[skirt], 0.0)
            background = background + float(np.median(excess / shape[skirt])) * shape
    return sorted(kept)


def _with_bands(curve: _Curve, tops: list[int], low: float, high: float) -> list[Candidate]:
    """Each peak with the band up to the deepest valley towards its neighbours."""
    edges = [low]
    for left, right in pairwise(tops):
        valley = left + int(np.argmin(curve.level_db[left:right]))
        edges.append(float(curve.frequency_hz[valley]))
    edges.append(high)
    return [
        Candidate(
            float(curve.frequency_hz[top]), edges[i], edges[i + 1], float(curve.level_db[top])
        )
        for i, top in enumerate(tops)
    ]

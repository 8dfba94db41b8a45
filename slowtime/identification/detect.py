"""Samples in, the resonances that stand significantly above their neighbourhood out."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.signal import find_peaks
from scipy.special import gammainccinv

from slowtime.signals.spectra import noise_floor, periodogram, smoothed

FALSE_ALARM = 1e-3
"""Probability that a record of stationary noise shows a candidate at all."""

SMOOTHING = 0.01
"""Half-width, relative to frequency, over which ordinates are averaged before peaks are read."""

HANN_WORTH = 1.94
"""Hann correlates neighbours: so many ordinates carry the information of one."""

VALLEY_DB = 6.0
"""Two peaks are two modes if the valley between them is this deep, beyond its scatter."""

NEIGHBOUR = 2.0**0.25
COMPANION_DB = 8.0
"""A peak this much weaker than another within a quarter octave is that one's companion."""


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
    curve = _curve(columns, rate_hz, taper)
    inside = (curve.frequency_hz >= low) & (curve.frequency_hz <= high)
    height = np.where(inside, curve.level_db, -np.inf)
    tops = np.asarray(find_peaks(np.maximum(height, -300.0))[0])
    tops = tops[height[tops] > _threshold_db(curve.worth[tops], int(inside.sum()))]
    separate = _separate(curve, tops[np.argsort(-height[tops])])
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
    curve = _curve(columns, rate_hz, taper)
    inside = (curve.frequency_hz >= low) & (curve.frequency_hz <= high)
    top = int(np.argmax(np.where(inside, curve.level_db, -np.inf)))
    return Candidate(float(curve.frequency_hz[top]), low, high, float(curve.level_db[top]))


def leading(found: list[Candidate]) -> list[Candidate]:
    """Candidates without the companions of stronger close ones."""

    def is_companion(one: Candidate) -> bool:
        return any(
            other.prominence_db > one.prominence_db + COMPANION_DB
            and 1 / NEIGHBOUR < other.frequency_hz / one.frequency_hz < NEIGHBOUR
            for other in found
        )

    return [one for one in found if not is_companion(one)]


def _curve(columns: np.ndarray, rate_hz: float, taper: str) -> _Curve:
    spectrum = periodogram(columns, rate_hz, taper=taper)
    floor = np.maximum(noise_floor(spectrum.density), 1e-300)
    ratio = (spectrum.density / floor).mean(axis=1, keepdims=True)
    level, number = smoothed(ratio, SMOOTHING)
    return _Curve(
        spectrum.frequency_hz,
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


def _with_bands(curve: _Curve, tops: list[int], low: float, high: float) -> list[Candidate]:
    """Each peak with the band up to the deepest valley towards its neighbours."""
    edges = [low]
    for left, right in zip(tops, tops[1:], strict=False):
        valley = left + int(np.argmin(curve.level_db[left:right]))
        edges.append(float(curve.frequency_hz[valley]))
    edges.append(high)
    return [
        Candidate(
            float(curve.frequency_hz[top]), edges[i], edges[i + 1], float(curve.level_db[top])
        )
        for i, top in enumerate(tops)
    ]

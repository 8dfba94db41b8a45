"""Detection of resonance peaks that are significant above the noise floor."""

import bisect
import dataclasses
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int
from scipy.special import gammainccinv

from slowtime.identification import checks
from slowtime.signals.peaks import local_maxima
from slowtime.signals.spectra import noise_floor, periodogram, smoothed

FALSE_ALARM = 1e-3
"""Probability that stationary noise shows any candidate."""

SMOOTHING = 0.01
"""Half-width of the spectral average, relative to frequency [1]."""

HANN_WORTH = 1.94
"""Number of Hann-tapered ordinates with the information of one independent ordinate."""

VALLEY_DB = 6.0
"""Depth of the valley between two separate peaks, beyond its scatter [dB]."""

COMPANION_DB = 8.0
"""Level difference of a companion within a quarter octave of a stronger peak [dB]."""

COMPANION_DB_PER_OCTAVE = 32.0
"""Additional level difference per octave of distance [dB]."""

SKIRT, SKIRT_FROM = 0.5, 0.08
"""Range of a mode's skirt, in ln frequency, and half-width of its peak relative to frequency,
which is left out [1]."""

SKIRT_ORDINATES = 8192
"""Largest number of ordinates whose median sets the level of a skirt."""

RESOLVED_BINS = 8.0
"""Distance of two peaks below which they are not resolved [bins]."""

UNRESOLVED_DB = 3.0
"""Level difference of a companion that is not resolved [dB]."""


@dataclasses.dataclass(frozen=True, slots=True)
class PeakCandidate:
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


def detect_peaks(
    columns: Float[np.ndarray, "time channel"],
    rate_hz: float,
    low: float,
    high: float,
    *,
    taper: str = "hann",
) -> list[PeakCandidate]:
    """Peaks that are significant above the noise floor, ascending in frequency.

    Every channel's Hann periodogram is divided by its own floor; the mean over channels of n
    ordinates exceeds the quantile of a gamma law with probability `FALSE_ALARM` over the whole
    spectrum.
    """
    curve = _curve(columns, rate_hz, taper, high)
    inside = (curve.frequency_hz >= low) & (curve.frequency_hz <= high)
    height = np.where(inside, curve.level_db, -300.0)
    tops = local_maxima(np.maximum(height, -300.0, out=height))
    threshold = _threshold_db(curve.worth[tops], int(inside.sum()))
    high_enough = height[tops] > threshold
    tops, threshold = tops[high_enough], threshold[high_enough]
    # What is weak beside a close, stronger peak is left to that one's fit.
    separate = separate_peaks(curve.level_db, tops, _valley_db(curve.worth[tops]))
    thresholds = dict(zip(tops.tolist(), threshold.tolist(), strict=True))
    above = _above_skirts(curve, separate, thresholds)
    return _with_bands(curve, above, low, high)


def detect_separate_peaks(
    columns: Float[np.ndarray, "time channel"],
    rate_hz: float,
    band_hz: tuple[float, float] | None,
    *,
    taper: str = "hann",
) -> list[PeakCandidate]:
    """Peaks without companions whose own bands overlap the band that is reported."""
    usual = checks.band(None, rate_hz, len(columns))
    given = None if band_hz is None else checks.band(band_hz, rate_hz, len(columns))
    # Peaks are sought in the whole record, so that the band of a candidate ends at the valley
    # to its neighbour, and not at an edge that the user chose. A peak just outside is returned
    # too, because the frequency of its mode may lie inside.
    found = without_companions(
        detect_peaks(columns, rate_hz, *checks.modelled_band(given, usual), taper=taper),
        len(columns) / rate_hz,
    )
    if given is None:
        return found
    return [one for one in found if one.low_hz < given[1] and one.high_hz > given[0]]


def strongest_peak(
    columns: Float[np.ndarray, "time channel"],
    rate_hz: float,
    low: float,
    high: float,
    *,
    taper: str = "hann",
) -> PeakCandidate:
    """Peak with the highest prominence, significant or not.

    Limits are those of its frequency; its band ends at the valleys to its neighbours, which may
    lie outside.
    """
    usual = checks.band(None, rate_hz, len(columns))
    everywhere = detect_peaks(
        columns, rate_hz, *checks.modelled_band((low, high), usual), taper=taper
    )
    found = [one for one in everywhere if low <= one.frequency_hz <= high]
    if found:
        return max(found, key=lambda c: c.prominence_db)
    curve = _curve(columns, rate_hz, taper, high)
    inside = (curve.frequency_hz >= low) & (curve.frequency_hz <= high)
    top = int(np.argmax(np.where(inside, curve.level_db, -np.inf)))
    return PeakCandidate(float(curve.frequency_hz[top]), low, high, float(curve.level_db[top]))


def without_companions(found: list[PeakCandidate], duration_s: float) -> list[PeakCandidate]:
    """Remove the companions (side lobes, lesser close modes) of stronger peaks."""
    lead = [c for c in found if not any(_outshines(other, c, duration_s) for other in found)]
    for companion in found:
        if any(c.frequency_hz == companion.frequency_hz for c in lead):
            continue
        distance = [abs(np.log(c.frequency_hz / companion.frequency_hz)) for c in lead]
        near = int(np.argmin(distance))
        host = lead[near]
        if distance[near] < np.log(2.0):
            # The band of a companion goes to its nearest stronger neighbour, so that both are
            # fitted together.
            lead[near] = dataclasses.replace(
                host,
                low_hz=min(host.low_hz, companion.low_hz),
                high_hz=max(host.high_hz, companion.high_hz),
            )
    return lead


def _outshines(other: PeakCandidate, one: PeakCandidate, duration_s: float) -> bool:
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
    floor = noise_floor(density)
    # In place, here and below: of a long record there are millions.
    density /= np.maximum(floor, 1e-300, out=floor)
    del floor
    ratio = density if density.shape[1] == 1 else density.mean(axis=1, keepdims=True)
    means, number = smoothed(ratio, SMOOTHING)
    level = np.maximum(means[:, 0], 1e-30)
    del means, ratio, density, spectrum
    np.log10(level, out=level)
    level *= 10
    number /= HANN_WORTH
    return _Curve(frequency, level, np.maximum(number, 1.0, out=number))


def _threshold_db(worth: np.ndarray, bins: int) -> np.ndarray:
    # Many ordinates are worth the same, and the quantile is dear.
    values, place = np.unique(worth, return_inverse=True)
    # The floor is estimated from few dozen ordinates where bins are few; hence the factor.
    level = 1.5 * gammainccinv(values, FALSE_ALARM / bins) / values
    return np.asarray(10 * np.log10(level))[place]


def _valley_db(worth: np.ndarray) -> np.ndarray:
    """Depth of a valley that parts a peak from a higher one, its scatter included [dB]."""
    return np.asarray(VALLEY_DB + 2 * 4.34 / np.sqrt(worth))


def separate_peaks(
    level_db: Float[np.ndarray, " frequency"],
    tops: Int[np.ndarray, " peak"],
    valley_db: Float[np.ndarray, " peak"],
) -> list[int]:
    """Peaks that a valley separates from every higher one.

    A valley on the way to the nearest higher peak that is kept, on either side, lies on the way
    to all those behind it as well. With the minima between neighbours in a table of powers of
    two [1]_ the work is of the order of n log n for n peaks.

    `tops` and the places returned are indices, ascending; `valley_db` is how far below each
    peak its valley has to reach [dB].

    References
    ----------
    .. [1] M. A. Bender, M. Farach-Colton, "The LCA problem revisited", LATIN (2000): range
       minimum queries by a sparse table.

    Examples
    --------
    >>> level = np.array([0.0, 20.0, 15.0, 18.0, 0.0, 12.0, 0.0])
    >>> separate_peaks(level, np.array([1, 3, 5]), np.full(3, 6.0))
    [1, 5]
    """
    if len(tops) == 0:
        return []
    table = _minima_table(np.minimum.reduceat(level_db, tops))
    height = level_db[tops]
    ceilings = (height - valley_db).tolist()
    kept: list[int] = []
    for peak in np.argsort(-height).tolist():
        at = bisect.bisect(kept, peak)
        beside = [(kept[at - 1], peak)] if at > 0 else []
        beside += [(peak, kept[at])] if at < len(kept) else []
        if all(_least(table, first, last) < ceilings[peak] for first, last in beside):
            kept.insert(at, peak)
    separate: list[int] = tops[kept].tolist()
    return separate


def _minima_table(between: Float[np.ndarray, " peak"]) -> list[list[float]]:
    """Minima over 1, 2, 4 … neighbouring stretches, from each of them on."""
    rows = [between]
    while 2 ** len(rows) <= len(between):
        half, last = 2 ** (len(rows) - 1), rows[-1]
        rows.append(np.minimum(last[:-half], last[half:]))
    return [row.tolist() for row in rows]


def _least(table: list[list[float]], first: int, last: int) -> float:
    """Minimum of the stretches from `first` up to `last`, of which there is at least one."""
    power = (last - first).bit_length() - 1
    row = table[power]
    return min(row[first], row[last - (1 << power)])


def _above_skirts(curve: _Curve, tops: list[int], threshold: dict[int, float]) -> list[int]:
    r"""From the highest down, the peaks significant above the skirts of the higher ones too."""
    kept: list[int] = []
    background: Float[np.ndarray, " frequency"] = np.ones(len(curve.level_db))
    for top in sorted(tops, key=lambda k: -curve.level_db[k]):
        if curve.level_db[top] - 10 * np.log10(background[top]) <= threshold[top]:
            continue
        kept.append(top)
        # Far from its resonance, at W = f / f0, a mode's acceleration under white force has the
        # density c W^4 / (1 - W^2)^2; c is the median of what is there, which lesser peaks do
        # not move.
        _add_skirt(curve, top, background)
    return sorted(kept)


def _add_skirt(curve: _Curve, top: int, background: Float[np.ndarray, " frequency"]) -> None:
    """Add to a background what a peak sends to either side."""
    frequency = curve.frequency_hz[top]
    edges = frequency * np.exp([-SKIRT, SKIRT])
    low, high = np.searchsorted(curve.frequency_hz, edges, side="right")
    ratio = curve.frequency_hz[low:high] / frequency
    square = ratio**2
    shape = square**2 / np.maximum((1 - square) ** 2, 1e-3)
    skirt = low + np.flatnonzero(np.abs(ratio - 1) > SKIRT_FROM)
    skirt = skirt[:: max(1, len(skirt) // SKIRT_ORDINATES)]
    if len(skirt):
        level = 10 ** (curve.level_db[skirt] / 10)
        excess = np.maximum(level - background[skirt], 0.0)
        background[low:high] += float(np.median(excess / shape[skirt - low])) * shape


def _with_bands(curve: _Curve, tops: list[int], low: float, high: float) -> list[PeakCandidate]:
    """Each peak with the band up to the deepest valley towards its neighbours."""
    edges = [low]
    for left, right in pairwise(tops):
        valley = left + int(np.argmin(curve.level_db[left:right]))
        edges.append(float(curve.frequency_hz[valley]))
    edges.append(high)
    return [
        PeakCandidate(
            float(curve.frequency_hz[top]), edges[i], edges[i + 1], float(curve.level_db[top])
        )
        for i, top in enumerate(tops)
    ]

"""Choice of the segment of a record that determines a frequency best."""

import dataclasses
from itertools import pairwise

import numpy as np

from slowtime.identification.detection.mode_isolation import IsolatedSeries
from slowtime.identification.detection.resonance_peaks import PeakCandidate
from slowtime.identification.estimates import Identified, Measured

from .decay_errors import SegmentFit, mode_of_fit
from .decay_fit import fit_decays, matrix_pencil
from .estimation import (
    SpannedSegment,
    explained_early,
    fit_segment,
    fit_spanned,
    index_of_candidate,
)

PARTS = 8
"""Number of parts of a record at whose ends segments begin and end."""

SHORTEST = 4
"""Least length of a segment [parts]."""

FINALISTS = 3
"""Number of segments that are fitted in full."""

ADDED_BY_FIT = 0.3
"""Share of the power that a fit may explain beyond its first steps [1]. Source: of 62 simulated
records that were no plain decays, those explained to 60 % or more gained 0.18 at most."""

CHOSEN = 1.1
"""Factor on the smallest of several estimated errors, which is too small on average (from
simulations)."""

CHANCE = 3.84
"""Squared score of the difference of two halves that is attributed to chance (95 % quantile of
chi-square with one degree of freedom)."""

FEWEST_CYCLES = 4.0
"""Least length of a segment [cycles]."""

FEWEST_SAMPLES = 24
"""Least length of half a segment [samples]."""


def best_segment(
    part: IsolatedSeries, candidate: PeakCandidate, *, least: float = 0.0
) -> SegmentFit | None:
    """Decay fit of the segment with the smallest standard error of the frequency.

    It explains at least the share `least` of the power; None where none does. It is flagged
    `part_of_record` if the segment is not the whole.
    """
    options = _stretches(part, candidate)
    spanned = [SpannedSegment.of(one) for one in options]
    spanned.sort(key=lambda one: _quick_error(one, candidate))
    finalists = spanned[:FINALISTS]
    # Fits to what is no decay take all their steps, and gain little after the first ones.
    if all(explained_early(one, candidate) < least - ADDED_BY_FIT for one in finalists):
        return None
    fitted = [(one.part, fit_spanned(one, candidate)) for one in finalists]
    # Halves cost twice what the whole does, and tell nothing of a segment that is no decay.
    if all(fit.explained < least for _, fit in fitted):
        return None
    fits = [_with_change(one, fit, candidate) for one, fit in fitted]
    # An impact, a move or another disturbance inside a stretch is not a decay: it leaves a
    # residual, the residual widens the error, and the stretch loses to one without.
    best = min(fits, key=lambda fit: fit.identified.frequency_hz.sd)
    whole = options[0]
    mode = best.identified
    if mode.span_s != (whole.start_s, whole.start_s + _seconds(whole)):
        mode = dataclasses.replace(mode, flags=(*mode.flags, "part_of_record"))
    if len(options) > 1:
        mode = dataclasses.replace(
            mode,
            frequency_hz=Measured(mode.frequency_hz.value, CHOSEN * mode.frequency_hz.sd),
            damping_ratio=Measured(mode.damping_ratio.value, CHOSEN * mode.damping_ratio.sd),
        )
    return dataclasses.replace(best, identified=mode)


def may_change(first: Measured, second: Measured) -> bool:
    """Whether `widen_for_change` widens anything by halves whose errors are at least these.

    Parameters
    ----------
    first, second
        Frequencies of the halves, with the least errors that they can have [Hz].

    Returns
    -------
    False if their difference is chance whatever the errors are.
    """
    chance = first.sd**2 + second.sd**2
    return not (first.value - second.value) ** 2 <= CHANCE * chance


def widen_for_change(mode: Identified, first: Measured, second: Measured) -> Identified:
    """Add the change between two halves of a record to the error of its mode.

    The mode is flagged `changes_within_record` beyond three standard deviations.
    """
    if not np.isfinite([mode.frequency_hz.sd, first.sd, second.sd]).all():
        return mode
    change = first.value - second.value
    chance = first.sd**2 + second.sd**2
    # A frequency that moves uniformly over a record moves by half its range between the means
    # of the halves, and its spread about the mean is that over sqrt(3). What the halves' own
    # errors explain, with a probability of 95 %, is taken off.
    beyond = max(change**2 - CHANCE * chance, 0.0) / 3
    flags = mode.flags
    if change**2 > 9 * chance:
        flags = (*flags, "changes_within_record")
    sd = float(np.hypot(mode.frequency_hz.sd, np.sqrt(beyond)))
    correlation = mode.correlation * mode.frequency_hz.sd / sd if sd else mode.correlation
    return dataclasses.replace(
        mode,
        frequency_hz=dataclasses.replace(mode.frequency_hz, sd=sd),
        correlation=correlation,
        flags=flags,
    )


def _seconds(part: IsolatedSeries) -> float:
    return len(part.series) / part.rate_hz


def _stretches(part: IsolatedSeries, candidate: PeakCandidate) -> list[IsolatedSeries]:
    """List the whole, then every run of eighths that is long enough."""
    count = len(part.series)
    edges = np.linspace(0, count, PARTS + 1).round().astype(int)
    shortest = FEWEST_CYCLES / candidate.frequency_hz * part.rate_hz
    found = [part]
    for first in range(PARTS):
        for last in range(first + SHORTEST, PARTS + 1):
            if last - first < PARTS and edges[last] - edges[first] >= max(
                shortest, 2 * FEWEST_SAMPLES
            ):
                found.append(_cut(part, int(edges[first]), int(edges[last])))
    return found


def _cut(part: IsolatedSeries, begin: int, end: int) -> IsolatedSeries:
    return dataclasses.replace(
        part, series=part.series[begin:end], start_s=part.start_s + begin / part.rate_hz
    )


def _quick_error(spanned: SpannedSegment, candidate: PeakCandidate) -> float:
    """Error of the frequency with poles straight from the matrix pencil."""
    part, drift = spanned.part, spanned.drift
    poles = matrix_pencil(spanned.space, part.rate_hz, 2)
    hz = poles.imag / (2 * np.pi)
    poles = poles[
        (hz > part.low_hz)
        & (hz < part.high_hz)
        & (poles.real > -poles.imag)
        & (poles.real * _seconds(part) < 3.0)
    ]
    if len(poles) == 0:
        return float("inf")
    fit = fit_decays(part.series, part.rate_hz, poles, drift, steps=0)
    which = index_of_candidate(fit, _seconds(part), candidate, part.shift_hz)
    if which is None:
        return float("inf")
    told = mode_of_fit(fit, which, part.rate_hz, part.start_s, part.band_hz, part.shift_hz)
    return told.identified.frequency_hz.sd


def _with_change(part: IsolatedSeries, fit: SegmentFit, candidate: PeakCandidate) -> SegmentFit:
    """Put what the frequency does between the halves of a stretch into its error."""
    middle = len(part.series) // 2
    if middle < FEWEST_SAMPLES or _seconds(part) * candidate.frequency_hz < 2 * FEWEST_CYCLES:
        return fit
    cuts = [_cut(part, a, b) for a, b in pairwise((0, middle, len(part.series)))]
    halves = [fit_segment(cut, candidate).identified.frequency_hz for cut in cuts]
    return dataclasses.replace(
        fit, identified=widen_for_change(fit.identified, halves[0], halves[1])
    )

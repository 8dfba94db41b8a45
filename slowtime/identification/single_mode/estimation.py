"""Modes of a record with unknown excitation, each fitted by itself."""

import dataclasses
from typing import Literal

import numpy as np
import scipy.fft as fft
from jaxtyping import Float

from slowtime.identification import checks
from slowtime.identification.ambient.estimation import fit_ambient, fit_ambient_steady
from slowtime.identification.detection.channel_combination import modal_series
from slowtime.identification.detection.mode_isolation import IsolatedSeries, isolate_mode
from slowtime.identification.detection.record_decimation import LONG, LongRecord
from slowtime.identification.detection.resonance_peaks import (
    PeakCandidate,
    detect_separate_peaks,
)
from slowtime.identification.estimates import Identified, Measured
from slowtime.identification.free_decay.decay_test import is_random
from slowtime.identification.free_decay.estimation import (
    FRONT_SHARE,
    MOST_MODES,
    fit_impact_decay,
)
from slowtime.identification.free_decay.segments import best_segment
from slowtime.identification.harmonics.detection import LEAST_DAMPING, classify_peaks
from slowtime.identification.options import OneByOne
from slowtime.signals.spectra import detrended

from .excitation import excitation
from .spectral_peak import fit_peak

EXPLAINED = 0.9
"""Least share of the power that decays explain in a free decay."""

CLEARLY = 0.99
"""Least share where the residual is coloured: decays explain 90 to 95 % of a random response
that is shorter than its memory."""

MAINS_HZ = (50.0, 60.0)
"""Frequencies of electric mains [Hz]."""


BEGINNING = 128.0
"""Sampling rate that is kept of a decay after an impact [samples per cycle]."""

BURST_SHARE = 0.85
"""Share of the power in two neighbouring eighths of a record above which it is a burst."""

HIGHEST_DAMPING = 0.3
"""Largest damping ratio of a mode [1]."""

FASTEST_GROWTH = 0.02
"""Largest negative damping ratio of a mode, by its amount [1]."""

LARGEST_ERROR = 0.1
"""Largest relative standard deviation of a frequency [1]."""


def first_mode(
    samples: Float[np.ndarray, "time channel"] | Float[np.ndarray, " time"],
    rate_hz: float,
    *,
    band_hz: tuple[float, float] | None = None,
    method: OneByOne = "auto",
    expected_hz: tuple[float, float] | None = None,
) -> Identified | None:
    """Lowest mode that stands out of the noise, however it was excited.

    Peaks significant against their own neighbourhood are tried from the lowest up, without the
    weak companions of close stronger ones. Each is fitted as decay, over the stretch of the
    record that tells its frequency best, and, where decays do not explain what is there, as
    ambient response; a record that begins with a blow is fitted whole. A frequency that moves
    within the stretch widens the error and is flagged.

    Parameters
    ----------
    samples
        Equally spaced samples in any unit; channels are weighted by the noise they carry.
    rate_hz
        Samples per second [Hz].
    band_hz
        Report a mode only there; by default from four cycles in the record to 0.45 of the
        rate. Neighbours outside are taken into account.
    method
        `auto`, or one fit for every record.
    expected_hz
        Where the mode was before, and how far it may have moved (one sd) [Hz]: of several
        candidates the one closest to it within four sd is tried first. Others stay allowed.

    Returns
    -------
    None where nothing significant is found.
    """
    columns = detrended(checks.series(samples, rate_hz))
    if band_hz is not None:
        band_hz = checks.band(band_hz, rate_hz, len(columns))
    record = LongRecord(columns, rate_hz)
    struck = None
    if method in ("auto", "free_decay") and expected_hz is None:
        struck = _after_a_blow(record, band_hz)
        # Something else that happened in the record shows in the residual; stretches can tell.
        if struck is not None and "coloured_residual" not in struck.flags:
            return struck
    found = detect_separate_peaks(columns, rate_hz, band_hz)
    for candidate in _in_order(found, expected_hz):
        mode = _mode(record, candidate, method)
        if not _is_reported(mode, candidate, band_hz):
            continue
        found_out = classify_fit(mode)
        if found_out == "mode":
            return _decaying(_with_force(mode, record))
        if found_out == "unclear":
            return None
    return struck


def all_modes(
    samples: Float[np.ndarray, "time channel"] | Float[np.ndarray, " time"],
    rate_hz: float,
    *,
    band_hz: tuple[float, float] | None = None,
    method: OneByOne = "auto",
    most: int = 8,
) -> tuple[Identified, ...]:
    """All separate modes of a record, fitted as `first_mode` fits one.

    Parameters
    ----------
    samples
        Equally spaced samples in any unit, channels in columns.
    rate_hz
        Sampling rate [Hz].
    band_hz
        Of the modes that are reported [Hz]; by default from four cycles in the record to 0.45
        of the rate.
    method
        `auto`, or one method for every peak.
    most
        Largest number of modes.

    Returns
    -------
    Modes, ascending in frequency.
    """
    columns = detrended(checks.series(samples, rate_hz))
    modes: list[Identified] = []
    record = LongRecord(columns, rate_hz)
    for candidate in detect_separate_peaks(columns, rate_hz, band_hz):
        mode = _mode(record, candidate, method)
        if _is_reported(mode, candidate, band_hz) and classify_fit(mode) == "mode":
            modes.append(_decaying(mode))
        if len(modes) == most:
            break
    return tuple(sorted(modes, key=lambda mode: mode.frequency_hz.value))


def _is_reported(
    mode: Identified, candidate: PeakCandidate, band_hz: tuple[float, float] | None
) -> bool:
    """Whether a mode lies in the band; of a fit without a frequency its candidate decides."""
    told = "strayed" not in mode.flags and np.isfinite(mode.frequency_hz.value)
    frequency = mode.frequency_hz.value if told else candidate.frequency_hz
    return checks.is_inside(frequency, band_hz)


def _mode(record: LongRecord, candidate: PeakCandidate, method: OneByOne) -> Identified:
    """Mode behind a candidate, at the rate that it needs; flagged if a machine put it there."""
    slower, own = record.about(candidate)
    mode = identify_candidate(slower.samples, slower.rate_hz, own, method)
    if method == "auto":
        mode = _flag_machine(mode, slower.samples, slower.rate_hz)
    return _begun(mode, slower.start_s)


def _begun(mode: Identified, start_s: float) -> Identified:
    """Mode of a series that begins so long after the record."""
    begin, end = mode.span_s
    return dataclasses.replace(mode, span_s=(begin + start_s, end + start_s))


def classify_fit(mode: Identified) -> Literal["mode", "no mode", "unclear"]:
    """Classify a fit as a mode, as no mode (bump, line), or as unclear.

    Where a significant peak stays unclear, as across a jump or a burst, a higher mode must
    not be passed off as the first one.

    Parameters
    ----------
    mode
        Fitted mode.

    Returns
    -------
    Class of the fit.
    """
    frequency, damping = mode.frequency_hz, mode.damping_ratio
    numbers = [frequency.value, frequency.sd, damping.value, damping.sd]
    if "strayed" in mode.flags:
        return "unclear"
    if {"below_threshold", "line", "on_edge"} & set(mode.flags) or not np.isfinite(
        numbers
    ).all():
        return "no mode"
    if frequency.sd > LARGEST_ERROR * frequency.value or damping.value > HIGHEST_DAMPING:
        return "no mode"
    if "not_stationary" in mode.flags or (
        mode.method == "ambient" and "not_converged" in mode.flags
    ):
        return "unclear"
    return "mode" if damping.value > -FASTEST_GROWTH else "unclear"


def identify_candidate(
    columns: Float[np.ndarray, "time channel"],
    rate_hz: float,
    candidate: PeakCandidate,
    method: OneByOne = "auto",
) -> Identified:
    """Fit the mode of a candidate by the given method, or by the one that suits the record.

    Parameters
    ----------
    columns
        Samples of all channels, in any unit.
    candidate
        Detected peak, with the band that belongs to it [Hz].
    method
        `auto`, or one method.

    Returns
    -------
    Mode with flags.
    """
    if method == "peak":
        return fit_peak(columns, rate_hz, candidate)
    if method == "ambient":
        return fit_ambient(columns, rate_hz, candidate)
    series = modal_series(columns, rate_hz, candidate)
    part = isolate_mode(series, rate_hz, candidate)
    doubtful: Identified | None = None
    if method == "free_decay" or not is_random(part, candidate):
        best = best_segment(part, candidate, least=0.0 if method == "free_decay" else EXPLAINED)
        coloured = best is not None and "coloured_residual" in best.identified.flags
        enough = CLEARLY if coloured else EXPLAINED
        if best is not None and (method == "free_decay" or best.explained >= enough):
            doubtful = _flag_line(best.identified)
            if (
                method == "free_decay"
                or best.explained >= CLEARLY
                or not _is_in_doubt(doubtful)
            ):
                return doubtful
    steady = fit_ambient_steady(columns, rate_hz, candidate)
    is_burst = _is_burst(_in_band(series, rate_hz, part))
    if doubtful is not None and (is_burst or classify_fit(steady) != "mode"):
        return doubtful
    if is_burst:
        steady = dataclasses.replace(steady, flags=(*steady.flags, "not_stationary"))
    return _flag_line(steady)


def _is_in_doubt(decay: Identified) -> bool:
    """Whether a decay may be a mode driven at random, of which a part looks like one.

    Seen for a few times its memory, the best part of a random response is explained by decays
    to 90 or 97 %, and what they leave is too short to show that it is no noise.
    """
    return not {"part_of_record", "not_decaying"}.isdisjoint(decay.flags)


def _after_a_blow(record: LongRecord, band_hz: tuple[float, float] | None) -> Identified | None:
    """Lowest mode of a record that begins with a blow and says little else, or None."""
    columns, rate_hz = record.columns, record.rate_hz
    if not _is_struck(columns):
        return None
    # No taper: it would hide the beginning, which is where the decay is.
    everywhere = detect_separate_peaks(columns, rate_hz, None, taper="boxcar")
    asked = [one for one in everywhere if checks.is_inside(one.frequency_hz, band_hz)]
    if not asked:
        return None
    # All modes ring: those beyond the band are fitted with it, the nearest first.
    found = sorted(everywhere, key=lambda one: abs(one.frequency_hz - asked[0].frequency_hz))
    slower = record.at_rate_for(max(one.frequency_hz for one in found[:MOST_MODES]), BEGINNING)
    if not _is_struck(slower.samples):
        return None
    blow = fit_impact_decay(slower.samples[:LONG], slower.rate_hz, found)
    if blow is None or blow.explained < EXPLAINED:
        return None
    mode = _begun(blow.identified, slower.start_s)
    reported = _is_reported(mode, asked[0], band_hz) and classify_fit(mode) == "mode"
    return mode if reported else None


def _is_struck(columns: Float[np.ndarray, "time channel"]) -> bool:
    """Whether most of the power comes in the first half."""
    first = columns[: len(columns) // 2]
    whole = float(np.einsum("tc,tc->", columns, columns))
    return float(np.einsum("tc,tc->", first, first)) >= FRONT_SHARE * whole


def _in_order(
    found: list[PeakCandidate], expected_hz: tuple[float, float] | None
) -> list[PeakCandidate]:
    """From the lowest up, but the one closest to the expected frequency first."""
    if expected_hz is None:
        return found
    mean, sd = expected_hz
    if not (mean > 0 and sd > 0 and np.isfinite([mean, sd]).all()):
        raise ValueError(
            f"{expected_hz=} is not a frequency and its standard deviation. Give two positive "
            "numbers in Hz, or None."
        )
    near = [one for one in found if abs(one.frequency_hz - mean) <= 4 * sd]
    near.sort(key=lambda one: abs(one.frequency_hz - mean))
    return near[:1] + [one for one in found if one not in near[:1]]


def _flag_line(mode: Identified) -> Identified:
    """Flag a mode `line` if it could as well be the mains: undamped, at its frequency."""
    frequency, damping = mode.frequency_hz, mode.damping_ratio
    duration = mode.span_s[1] - mode.span_s[0]
    undamped = damping.value < max(2 * damping.sd, 0.2 / (frequency.value * duration))
    tolerance = 2 * frequency.sd + 0.1
    at_mains = any(
        round(frequency.value / mains) >= 1
        and abs(frequency.value - round(frequency.value / mains) * mains) < tolerance
        for mains in MAINS_HZ
    )
    if undamped and at_mains and damping.sd < 0.02:
        return dataclasses.replace(mode, flags=(*mode.flags, "line"))
    return mode


def _flag_machine(
    mode: Identified, columns: Float[np.ndarray, "time channel"], rate_hz: float
) -> Identified:
    """Flag a mode `line` that does not decay, and is steadier than a structure can be.

    A decay that was seen to fall off is none, however slowly it does.
    """
    damping, duration = mode.damping_ratio, len(columns) / rate_hz
    falls = mode.method == "free_decay" and damping.value > 4 * damping.sd
    if classify_fit(mode) != "mode" or falls or damping.value - 2 * damping.sd > LEAST_DAMPING:
        return mode
    if not 4 / duration < mode.frequency_hz.value < rate_hz / 2 - 4 / duration:
        return mode
    told = classify_peaks(columns, rate_hz, np.array([mode.frequency_hz.value]))[0]
    if told.kind == "structural":
        return mode
    return dataclasses.replace(mode, flags=(*mode.flags, "line"))


def _with_force(mode: Identified, record: LongRecord) -> Identified:
    """Flag an ambient mode whose force plainly was no steady random one."""
    if mode.method != "ambient":
        return mode
    near = record.near(mode.frequency_hz.value)
    force = excitation(near.samples, near.rate_hz)
    return dataclasses.replace(mode, flags=(*mode.flags, *force.flags))


def _in_band(
    series: Float[np.ndarray, " time"], rate_hz: float, part: IsolatedSeries
) -> Float[np.ndarray, " _"]:
    """Part of a series that lies in a band, from its first sample to its last."""
    if part.shift_hz:
        return part.series
    band_hz = part.band_hz
    frequency, coefficients = fft.rfftfreq(len(series), 1 / rate_hz), fft.rfft(series)
    coefficients[(frequency < band_hz[0]) | (frequency > band_hz[1])] = 0.0
    return np.asarray(fft.irfft(coefficients, len(series)))


def _is_burst(series: Float[np.ndarray, " time"]) -> bool:
    """Whether most of the power came at once, as no stationary excitation brings it."""
    power = np.array([np.sum(eighth**2) for eighth in np.array_split(series, 8)])
    return bool((power[1:] + power[:-1]).max() > BURST_SHARE * power.sum())


def _decaying(mode: Identified) -> Identified:
    """Put damping at the physical limit 0 where driving hid it."""
    damping = mode.damping_ratio
    if damping.value > 0:
        return mode
    limit = Measured(0.0, float(np.hypot(damping.sd, damping.value)))
    return dataclasses.replace(mode, damping_ratio=limit)

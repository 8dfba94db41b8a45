"""Alignment of the clocks of several boards on one structure.

Each board's clock model gives its time axis to some milliseconds; the structure's own motion
gives the rest, since both boards see its modes at the same time (see `common_motion`).
"""

import dataclasses
import itertools
import math

import numpy as np

from slowtime.identification import checks
from slowtime.identification.estimates import Measured

from .boards import Alignment, BoardRecord, ModeEvidence
from .clock_offset import (
    ClockPrior,
    OffsetCandidate,
    is_measured_by_both,
    search_offsets,
    solve_offset,
)
from .shared_modes import SharedMode, shared_modes

USABLE = 0.43
"""Of the slower board's rate: up to there resampling is right to a part in 10^4."""
CLEARLY = 3.0
"""Logarithm of how much more probable the offset must be than any other: 20 times."""
LARGEST_RAD = 0.1
"""Phase error (sd) at the highest shared mode, beyond which streams are not merged. With 1.96
of them the modal assurance criterion of a mode falls by at most 0.2^2 / 4 = 0.01."""
DISAGREEMENT_RAD = 0.3
"""Median phase that is left at the modes, beyond which they speak of no common offset."""


def align(
    first: BoardRecord, second: BoardRecord, *, band_hz: tuple[float, float] | None = None
) -> Alignment:
    """Put two boards of one structure on one clock, or say why that cannot be done.

    Modes that both see are sought in `band_hz`, by default from a few cycles in the common time
    to 0.43 of the slower rate. Raises `ValueError` where a channel holds no numbers, or a band
    is none.
    """
    ahead = ClockPrior.of(first, second)
    if ahead is None:
        return Alignment(
            merged=None,
            sentence="Not aligned: the boards did not record at the same time. Give records "
            "that overlap, or correct their starts.",
        )
    slower = min(first.rate_hz, second.rate_hz)
    one, two, rate_hz = _together(first, second)
    low, high = checks.band(band_hz, rate_hz, len(one))
    band = low, min(high, USABLE * slower)
    modes, times_s = shared_modes(checks.series(one, rate_hz), two, rate_hz, band)
    found = search_offsets(modes, times_s, ahead) if modes else []
    known = [mode for mode in modes if found and is_measured_by_both(mode, times_s, found[0])]
    if not known:
        return Alignment(
            merged=None,
            sentence="Not aligned: no mode is seen by both boards in common motion. Give a "
            "longer record, or check that they stand on one structure and that their clocks "
            "are known to a few milliseconds.",
        )
    if len(found) > 1 and found[0].score - found[1].score < CLEARLY:
        return _ambiguous(found, known)
    return _refined(first, second, found[0], ahead, band)


def _together(first: BoardRecord, second: BoardRecord) -> tuple[np.ndarray, np.ndarray, float]:
    """Both on the instants of the faster one, as far as both have recorded."""
    times_s, rate_hz = _instants(first, second)
    return first.at(times_s), second.at(times_s), rate_hz


def _instants(first: BoardRecord, second: BoardRecord) -> tuple[np.ndarray, float]:
    fast = first if first.rate_hz >= 0.99 * second.rate_hz else second
    begin, end = max(first.start_s, second.start_s), min(first.end_s, second.end_s)
    at = math.ceil((begin - fast.start_s) * fast.rate_hz - 1e-9)
    last = math.floor((end - fast.start_s) * fast.rate_hz + 1e-9)
    return fast.start_s + np.arange(at, last + 1) / fast.rate_hz, fast.rate_hz


def _ambiguous(found: list[OffsetCandidate], modes: list[SharedMode]) -> Alignment:
    listed = ", ".join(f"{1e3 * place.offset_s:+.1f}" for place in found[:3])
    return Alignment(
        merged=None,
        sentence=f"Not aligned: offsets of {listed} ms fit the phases of "
        f"{len(modes)} shared mode(s) about equally, half periods apart. Give boards whose "
        "start is known better, or a band with more modes that both see.",
    )


def _refined(
    first: BoardRecord,
    second: BoardRecord,
    place: OffsetCandidate,
    ahead: ClockPrior,
    band: tuple[float, float],
) -> Alignment:
    """Offset and drift by least squares on the phases that a first alignment leaves."""
    offset, drift = Measured(place.offset_s, math.inf), Measured(place.drift, math.inf)
    evidence: tuple[ModeEvidence, ...] = ()
    for _ in range(3):
        moved = _shifted(second, offset.value, drift.value, ahead.middle_s)
        one, two, rate_hz = _together(first, moved)
        modes, times_s = shared_modes(one, two, rate_hz, band)
        still = OffsetCandidate(0.0, 0.0, 0.0)
        modes = tuple(mode for mode in modes if is_measured_by_both(mode, times_s, still))
        if not modes:
            break
        more, drift_left, evidence = solve_offset(
            modes, times_s, ahead, offset.value, drift.value
        )
        offset = Measured(offset.value + more.value, more.sd)
        drift = Measured(drift.value + drift_left.value, drift_left.sd)
        if abs(more.value) < 0.1 * more.sd and abs(drift_left.value) < 0.1 * drift_left.sd:
            break
    return _verdict(first, second, offset, drift, evidence, ahead)


def _shifted(board: BoardRecord, offset_s: float, drift: float, middle_s: float) -> BoardRecord:
    """Later by an offset at the middle, faster by a drift: its start moves by both."""
    return board.moved(offset_s + drift * (middle_s - board.start_s), drift)


def _verdict(
    first: BoardRecord,
    second: BoardRecord,
    offset: Measured,
    drift: Measured,
    evidence: tuple[ModeEvidence, ...],
    ahead: ClockPrior,
) -> Alignment:
    whole = Measured(
        offset.value + drift.value * (ahead.middle_s - second.start_s),
        math.hypot(offset.sd, drift.sd * (ahead.middle_s - second.start_s)),
    )
    apart = Alignment(merged=None, sentence="", offset_s=whole, drift=drift, evidence=evidence)
    top = 2 * np.pi * max((e.frequency_hz for e in evidence), default=0.0)
    left = float(np.median([abs(e.phase_rad.value) for e in evidence])) if evidence else np.inf
    if not evidence or left > DISAGREEMENT_RAD:
        return dataclasses.replace(
            apart,
            sentence=f"Not aligned: the best offset leaves {left:.2f} rad of phase at the "
            f"shared modes (allowed {DISAGREEMENT_RAD:g}). Check that both boards stand on one "
            "structure; strongly complex modes cannot be aligned.",
        )
    error = math.hypot(top * offset.sd, top * drift.sd * ahead.seconds / math.sqrt(12))
    if not error <= LARGEST_RAD:
        worse = "offset" if offset.sd > drift.sd * ahead.seconds / 3.46 else "rates"
        return dataclasses.replace(
            apart,
            sentence=f"Not aligned: the {worse} of the boards would be known to "
            f"{error:.2f} rad at {top / 2 / np.pi:.3g} Hz (allowed {LARGEST_RAD:g}). Record "
            "longer, or give a band that leaves the highest modes out.",
        )
    moved = _shifted(second, offset.value, drift.value, ahead.middle_s)
    times_s, rate_hz = _instants(first, moved)
    merged = BoardRecord(
        samples=np.hstack([first.at(times_s), moved.at(times_s)]),
        channels=(*first.channels, *second.channels),
        rate_hz=rate_hz,
        rate_sd=first.rate_sd,
        start_s=float(times_s[0]),
        start_sd_s=first.start_sd_s,
    )
    sentence = (
        f"Aligned: the second board starts {1e3 * whole.value:+.2f} ± {1e3 * whole.sd:.2f} ms "
        f"from what it states, and its rate is off by {1e6 * drift.value:+.1f} ± "
        f"{1e6 * drift.sd:.1f} ppm from the first one's, by {len(evidence)} mode(s) that both "
        "see."
    )
    return dataclasses.replace(apart, merged=merged, sentence=sentence)


def align_all(
    boards: tuple[BoardRecord, ...], *, band_hz: tuple[float, float] | None = None
) -> tuple[BoardRecord, tuple[Alignment, ...]]:
    """Align each board with those before it that could be merged; leave out the others."""
    whole, said = boards[0], []
    for board in itertools.islice(boards, 1, None):
        found = align(whole, board, band_hz=band_hz)
        whole = found.merged if found.merged is not None else whole
        said.append(found)
    return whole, tuple(said)

"""Streams of several boards on one structure in, one stream on one clock out, or a reason why not.

Each board's clock model gives its time axis to some milliseconds; the structure's own motion
gives the rest, since both boards see its modes at the same time (see `common_motion`).
"""

import dataclasses
import itertools
import math

import numpy as np
from jaxtyping import Float

from slowtime.signals.interpolation import at_instants

from . import checks
from .common_motion import COMPLEX_RAD, SharedMode, shared_modes
from .identified import Measured

USABLE = 0.43
"""Of the slower board's rate: up to there resampling is right to a part in 10^4."""
GRID_RAD = 0.4
"""Step of the search, as a phase of the highest mode."""
CLEARLY = 3.0
"""Logarithm of how much more probable the offset must be than any other: 20 times."""
LARGEST_RAD = 0.1
"""Phase error (sd) at the highest shared mode, beyond which streams are not merged. With 1.96 of
them the modal assurance criterion of any mode falls by at most 0.2^2 / 4 = 0.01."""
DISAGREEMENT_RAD = 0.3
"""Median phase that is left at the modes, beyond which they speak of no common offset."""
MOST_POINTS = 4001
"""Of the search along either axis."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Board:
    """What one board recorded, on its own time axis.

    Parameters
    ----------
    samples
        Equally spaced.
    channels
        Name of each column.
    rate_hz, rate_sd
        Samples per second as far as known, and its relative standard deviation [1].
    start_s, start_sd_s
        Time of the first sample on the common axis, and its standard deviation [s].
    """

    samples: Float[np.ndarray, "time channel"]
    channels: tuple[str, ...]
    rate_hz: float
    rate_sd: float = 0.0
    start_s: float = 0.0
    start_sd_s: float = 0.0

    @property
    def end_s(self) -> float:
        """Time of the last sample [s]."""
        return self.start_s + (len(self.samples) - 1) / self.rate_hz

    def at(self, times_s: Float[np.ndarray, " instant"]) -> Float[np.ndarray, "instant channel"]:
        """Band-limited interpolation of the samples."""
        positions = (times_s - self.start_s) * self.rate_hz
        columns = np.asarray(self.samples, dtype=float).T
        return np.asarray(at_instants(np.ascontiguousarray(columns), positions).T)

    def moved(self, offset_s: float, drift: float) -> "Board":
        """Itself with its first sample later by an offset, and its rate higher by a drift."""
        return dataclasses.replace(
            self, start_s=self.start_s + offset_s, rate_hz=self.rate_hz * (1.0 + drift)
        )


@dataclasses.dataclass(frozen=True, slots=True)
class Evidence:
    """One mode that both boards see, and the phase between them that alignment has left.

    Parameters
    ----------
    frequency_hz
        Of the mode [Hz].
    phase_rad
        With its standard deviation [rad].
    coherence
        Between the boards at the mode [1].
    """

    frequency_hz: float
    phase_rad: Measured
    coherence: float


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alignment:
    """Whether two boards could be put on one clock.

    Parameters
    ----------
    merged
        All channels, on the time axis of the board that samples faster; None if not aligned.
    sentence
        What was found, or why the boards stay apart.
    offset_s
        What the second board's stated start lacks, with standard deviation [s].
    drift
        By which its stated rate is to be corrected, relative to the first one's [1].
    evidence
        The modes that it rests on.
    """

    merged: Board | None
    sentence: str
    offset_s: Measured | None = None
    drift: Measured | None = None
    evidence: tuple[Evidence, ...] = ()


def align(
    first: Board, second: Board, *, band_hz: tuple[float, float] | None = None
) -> Alignment:
    """Put two boards of one structure on one clock, or say why that cannot be done.

    Parameters
    ----------
    band_hz
        Where to look for modes that both see; by default from a few cycles in the common time
        to 0.43 of the slower rate.

    Raises
    ------
    ValueError
        Where a channel holds no numbers, or a band is none.
    """
    ahead = _Prior.of(first, second)
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
    found = _search(modes, times_s, ahead) if modes else []
    known = [mode for mode in modes if found and _moves(mode, times_s, found[0])]
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


@dataclasses.dataclass(frozen=True, slots=True)
class _Prior:
    """What the clock models say, at the middle of the common time."""

    middle_s: float
    seconds: float
    offset_sd_s: float
    drift_sd: float

    @classmethod
    def of(cls, first: Board, second: Board) -> "_Prior | None":
        begin = max(first.start_s, second.start_s)
        end = min(first.end_s, second.end_s)
        if end - begin <= 0:
            return None
        middle = (begin + end) / 2
        offset = math.hypot(
            first.start_sd_s,
            second.start_sd_s,
            first.rate_sd * (middle - first.start_s),
            second.rate_sd * (middle - second.start_s),
        )
        drift = math.hypot(first.rate_sd, second.rate_sd)
        return cls(middle, end - begin, max(offset, 1e-6), max(drift, 1e-10))


@dataclasses.dataclass(frozen=True, slots=True)
class _Place:
    """An offset at the middle [s], a drift, and the logarithm of their probability."""

    offset_s: float
    drift: float
    score: float


def _together(
    first: Board, second: Board
) -> tuple[np.ndarray, np.ndarray, float]:
    """Both on the instants of the faster one, as far as both have recorded."""
    times_s, rate_hz = _instants(first, second)
    return first.at(times_s), second.at(times_s), rate_hz


def _instants(first: Board, second: Board) -> tuple[np.ndarray, float]:
    fast = first if first.rate_hz >= 0.99 * second.rate_hz else second
    begin, end = max(first.start_s, second.start_s), min(first.end_s, second.end_s)
    at = math.ceil((begin - fast.start_s) * fast.rate_hz - 1e-9)
    last = math.floor((end - fast.start_s) * fast.rate_hz + 1e-9)
    return fast.start_s + np.arange(at, last + 1) / fast.rate_hz, fast.rate_hz


def _search(
    modes: tuple[SharedMode, ...], times_s: np.ndarray, ahead: _Prior
) -> list[_Place]:
    """Offsets that fit the phases at all modes, the most probable first."""
    top = 2 * np.pi * modes[-1].frequency_hz
    drifts = _grid(ahead.drift_sd, GRID_RAD / (top * ahead.seconds / 2))
    offsets = _grid(ahead.offset_sd_s, GRID_RAD / (2 * top))
    score = np.tile(-0.5 * (offsets / ahead.offset_sd_s) ** 2, (len(drifts), 1))
    for row, drift in enumerate(drifts):
        score[row] -= 0.5 * (drift / ahead.drift_sd) ** 2
        for mode in modes:
            phase, sd, coherence = mode.along(drift, times_s)
            # Half of the probability that a phase has: cos 2e is 1 - 2 e^2 for small ones.
            weight = 0.25 / (sd**2 + COMPLEX_RAD**2)
            beats = 2 * (phase + 2 * np.pi * mode.frequency_hz * offsets)
            score[row] += weight * coherence * np.cos(beats)
    best = score.max(axis=0)
    higher = np.r_[True, best[1:] > best[:-1]] & np.r_[best[:-1] >= best[1:], True]
    places = [
        _Place(float(offsets[at]), float(drifts[np.argmax(score[:, at])]), float(best[at]))
        for at in np.flatnonzero(higher)
    ]
    return sorted(places, key=lambda place: -place.score)


def _grid(sd: float, step: float) -> np.ndarray:
    """Points to four standard deviations on either side."""
    half = min(math.ceil(4 * sd / step), MOST_POINTS // 2)
    return np.arange(-half, half + 1) * step


def _moves(mode: SharedMode, times_s: np.ndarray, place: _Place) -> bool:
    return mode.along(place.drift, times_s)[2] > mode.least_coherence


def _ambiguous(found: list[_Place], modes: list[SharedMode]) -> Alignment:
    listed = ", ".join(f"{1e3 * place.offset_s:+.1f}" for place in found[:3])
    return Alignment(
        merged=None,
        sentence=f"Not aligned: offsets of {listed} ms fit the phases of "
        f"{len(modes)} shared mode(s) about equally, half periods apart. Give boards whose "
        "start is known better, or a band with more modes that both see.",
    )


def _refined(
    first: Board, second: Board, place: _Place, ahead: _Prior, band: tuple[float, float]
) -> Alignment:
    """Offset and drift by least squares on the phases that a first alignment leaves."""
    offset, drift = Measured(place.offset_s, math.inf), Measured(place.drift, math.inf)
    moved, evidence = second, ()
    for _ in range(3):
        moved = _shifted(second, offset.value, drift.value, ahead.middle_s)
        one, two, rate_hz = _together(first, moved)
        modes, times_s = shared_modes(one, two, rate_hz, band)
        still = _Place(0.0, 0.0, 0.0)
        modes = tuple(mode for mode in modes if _moves(mode, times_s, still))
        if not modes:
            break
        more, drift_left, evidence = _solve(modes, times_s, ahead, offset.value, drift.value)
        offset = Measured(offset.value + more.value, more.sd)
        drift = Measured(drift.value + drift_left.value, drift_left.sd)
        if abs(more.value) < 0.1 * more.sd and abs(drift_left.value) < 0.1 * drift_left.sd:
            break
    return _verdict(first, second, offset, drift, tuple(evidence), ahead)


def _shifted(board: Board, offset_s: float, drift: float, middle_s: float) -> Board:
    """Later by an offset at the middle, faster by a drift: its start moves by both."""
    return board.moved(offset_s + drift * (middle_s - board.start_s), drift)


def _solve(
    modes: tuple[SharedMode, ...],
    times_s: np.ndarray,
    ahead: _Prior,
    offset_s: float,
    drift: float,
) -> tuple[Measured, Measured, tuple[Evidence, ...]]:
    r"""Weighted least squares of :math:`-\theta / 2 \pi f = \delta - \rho t` over all stretches.

    What modes disagree about beyond their own errors widens the error of the offset; it is
    never less than if each mode's shape were complex by `COMPLEX_RAD`.
    """
    rows = [
        (mode.frequency_hz, time_s, *phase)
        for mode in modes
        for time_s, phase in zip(times_s.tolist(), mode.apart(), strict=True)
    ]
    f, time_s, phase, sd = np.array(rows).T
    turn = 2 * np.pi * f
    weight = (turn / np.hypot(sd, 0.5 * COMPLEX_RAD)) ** 2
    design = np.column_stack([np.ones_like(f), -time_s])
    prior = np.diag([ahead.offset_sd_s**-2, ahead.drift_sd**-2])
    known = design.T @ (weight[:, None] * design) + prior
    pull = prior @ np.array([-offset_s, -drift])
    solution = np.linalg.solve(known, design.T @ (weight * -phase / turn) + pull)
    left = phase + turn * (design @ solution)
    scatter = max(1.0, float(weight / turn**2 @ left**2) / max(len(f) - 2, 1))
    errors = np.sqrt(scatter * np.diag(np.linalg.inv(known)))
    evidence, means, floors = [], [], []
    for mode in modes:
        mine = f == mode.frequency_hz
        share = weight[mine] / weight[mine].sum()
        mean = float(share @ left[mine])
        own = float(np.sqrt(share**2 @ sd[mine] ** 2))
        coherence = mode.along(0.0, times_s)[2]
        evidence.append(Evidence(mode.frequency_hz, Measured(mean, own), coherence))
        means.append(mean / (2 * np.pi * mode.frequency_hz))
        floors.append((2 * np.pi * mode.frequency_hz) ** 2 / (own**2 + COMPLEX_RAD**2))
    between = np.array(floors)
    spread = float(between @ np.array(means) ** 2) / max(len(modes) - 1, 1)
    systematic = math.sqrt(max(1.0, spread) / float(between.sum()))
    offset = Measured(float(solution[0]), float(max(errors[0], systematic)))
    return offset, Measured(float(solution[1]), float(errors[1])), tuple(evidence)


def _verdict(
    first: Board,
    second: Board,
    offset: Measured,
    drift: Measured,
    evidence: tuple[Evidence, ...],
    ahead: _Prior,
) -> Alignment:
    whole = Measured(
        offset.value + drift.value * (ahead.middle_s - second.start_s),
        math.hypot(offset.sd, drift.sd * (ahead.middle_s - second.start_s)),
    )
    told = {"offset_s": whole, "drift": drift, "evidence": evidence}
    top = 2 * np.pi * max((e.frequency_hz for e in evidence), default=0.0)
    left = float(np.median([abs(e.phase_rad.value) for e in evidence])) if evidence else np.inf
    if not evidence or left > DISAGREEMENT_RAD:
        return Alignment(
            merged=None,
            sentence=f"Not aligned: the best offset leaves {left:.2f} rad of phase at the "
            f"shared modes (allowed {DISAGREEMENT_RAD:g}). Check that both boards stand on one "
            "structure; strongly complex modes cannot be aligned.",
            **told,
        )
    error = math.hypot(top * offset.sd, top * drift.sd * ahead.seconds / math.sqrt(12))
    if not error <= LARGEST_RAD:
        worse = "offset" if offset.sd > drift.sd * ahead.seconds / 3.46 else "rates"
        return Alignment(
            merged=None,
            sentence=f"Not aligned: the {worse} of the boards would be known to "
            f"{error:.2f} rad at {top / 2 / np.pi:.3g} Hz (allowed {LARGEST_RAD:g}). Record "
            "longer, or give a band that leaves the highest modes out.",
            **told,
        )
    moved = _shifted(second, offset.value, drift.value, ahead.middle_s)
    times_s, rate_hz = _instants(first, moved)
    merged = Board(
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
    return Alignment(merged=merged, sentence=sentence, **told)


def align_all(
    boards: tuple[Board, ...], *, band_hz: tuple[float, float] | None = None
) -> tuple[Board, tuple[Alignment, ...]]:
    """Align each board with those before it that could be merged; what cannot is left out.

    Returns
    -------
    All that could be merged, and what was found of each board after the first.
    """
    whole, said = boards[0], []
    for board in itertools.islice(boards, 1, None):
        found = align(whole, board, band_hz=band_hz)
        whole = found.merged if found.merged is not None else whole
        said.append(found)
    return whole, tuple(said)

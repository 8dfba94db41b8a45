"""Least-squares offset and drift between two clocks from phases at shared modes."""

import dataclasses
import math

import numpy as np

from slowtime.identification.estimates import Measured

from .boards import BoardRecord, ModeEvidence
from .shared_modes import COMPLEX_RAD, SharedMode

GRID_RAD = 0.4
"""Step of the grid search, as a phase of the highest mode [rad]."""
MOST_POINTS = 4001
"""Largest number of grid points along either axis."""


@dataclasses.dataclass(frozen=True, slots=True)
class ClockPrior:
    """What the clock models say, at the middle of the common time."""

    middle_s: float
    seconds: float
    offset_sd_s: float
    drift_sd: float

    @classmethod
    def of(cls, first: BoardRecord, second: BoardRecord) -> "ClockPrior | None":
        """Prior from the clock models of two boards; None where they share no time."""
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
class OffsetCandidate:
    """An offset at the middle [s], a drift, and the logarithm of their probability."""

    offset_s: float
    drift: float
    score: float


def search_offsets(
    modes: tuple[SharedMode, ...], times_s: np.ndarray, ahead: ClockPrior
) -> list[OffsetCandidate]:
    """Local maxima of the posterior of offset and drift on a grid, the most probable first."""
    top = 2 * np.pi * modes[-1].frequency_hz
    drifts = symmetric_grid(ahead.drift_sd, GRID_RAD / (top * ahead.seconds / 2))
    offsets = symmetric_grid(ahead.offset_sd_s, GRID_RAD / (2 * top))
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
        OffsetCandidate(
            float(offsets[at]), float(drifts[np.argmax(score[:, at])]), float(best[at])
        )
        for at in np.flatnonzero(higher)
    ]
    return sorted(places, key=lambda place: -place.score)


def symmetric_grid(sd: float, step: float) -> np.ndarray:
    """Grid of points up to four standard deviations on either side of zero."""
    half = min(math.ceil(4 * sd / step), MOST_POINTS // 2)
    return np.arange(-half, half + 1) * step


def is_measured_by_both(mode: SharedMode, times_s: np.ndarray, place: OffsetCandidate) -> bool:
    """Whether the coherence of two boards at a mode exceeds that of noise."""
    return mode.along(place.drift, times_s)[2] > mode.least_coherence


def solve_offset(
    modes: tuple[SharedMode, ...],
    times_s: np.ndarray,
    ahead: ClockPrior,
    offset_s: float,
    drift: float,
) -> tuple[Measured, Measured, tuple[ModeEvidence, ...]]:
    r"""Weighted least squares of :math:`-\theta / 2 \pi f = \delta - \rho t`.

    What modes disagree about beyond their own errors widens the error of the offset; it is
    never less than if each mode's shape were complex by `COMPLEX_RAD`.

    Gives offset [s] and drift [1], and the residual phase of each mode.
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
        evidence.append(ModeEvidence(mode.frequency_hz, Measured(mean, own), coherence))
        means.append(mean / (2 * np.pi * mode.frequency_hz))
        floors.append((2 * np.pi * mode.frequency_hz) ** 2 / (own**2 + COMPLEX_RAD**2))
    between = np.array(floors)
    spread = float(between @ np.array(means) ** 2) / max(len(modes) - 1, 1)
    systematic = math.sqrt(max(1.0, spread) / float(between.sum()))
    offset = Measured(float(solution[0]), float(max(errors[0], systematic)))
    return offset, Measured(float(solution[1]), float(errors[1])), tuple(evidence)

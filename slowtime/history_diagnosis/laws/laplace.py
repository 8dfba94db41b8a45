"""Maximisation of the evidence over shapes and the random process, and its integral there."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import no_type_check

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from slowtime.history_diagnosis.data.history import ScaledHistory
from slowtime.history_diagnosis.likelihood import evidence
from slowtime.history_diagnosis.likelihood.whitening import MaternProcess

from .terms import ScreenedHistory, Term, design, design_priors, noise_variance

Point = Float[np.ndarray, " coordinate"]

_EVALUATIONS = 25
"""[evaluations for each coordinate] Of the simplex search. Source: a bound on computing
time."""
_EVIDENCE_DROP = 0.5
"""[nats] Below the peak, at which the width of a peak is read. Source: one standard deviation
of a Gaussian."""
_LONGEST_LENGTH = 0.6
"""[histories] Longest length scale of the random process: what is slower counts as a drift.
Source: chosen on hidden histories (decision 0030)."""
_LARGEST_SD = 2.0
"""[scatters of the readings] Largest standard deviation of the random process. Source: the
same."""
_NO_PROCESS = 0.3
"""[probability] Prior that there is no random process. Source: docs/what_decides.md: half and
double change no answer."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class LaplaceFit:
    """Terms and random process at the maximum of the evidence.

    Parameters
    ----------
    log_evidence
        Integrated over shapes and process, relative to other laws of the same readings [nats].
    spreads
        Standard deviation of each shape parameter, then of the logarithms of standard
        deviation and length of the process.
    """

    terms: tuple[Term, ...]
    process: MaternProcess
    log_evidence: float
    peak: float
    spreads: tuple[float, ...]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ShapeSpace:
    """Shapes of some terms and the random process, as a point in a box.

    Parameters
    ----------
    free, process
        Terms whose shapes are free, and the process, whose smoothness is fixed.
    finest
        Differences of each coordinate that do not matter.
    """

    before: tuple[Term, ...]
    free: tuple[Term, ...]
    process: MaternProcess
    box: Float[np.ndarray, "coordinate 2"]
    finest: Point
    steps: Point

    @property
    def start(self) -> Point:
        """Point at which the space was made."""
        point = [x for term in self.free for x in term.shape]
        if self.process.sd > 0.0:
            point += [np.log(self.process.sd), np.log(self.process.length)]
        inside: Point = np.clip(np.array(point, dtype=float), self.box[:, 0], self.box[:, 1])
        return inside

    @no_type_check
    def terms_at(self, point: Point) -> tuple[Term, ...]:
        """Return all terms at a point."""
        terms, at = list(self.before), 0
        for term in self.free:
            width = len(term.law.axes)
            terms.append(Term(term.law, tuple(point[at : at + width].tolist())))
            at += width
        return tuple(terms)

    @no_type_check
    def process_at(self, point: Point) -> MaternProcess:
        """Return the process at a point."""
        if self.process.sd == 0.0:
            return self.process
        sd, length = np.exp(point[-2:]).tolist()
        return MaternProcess(self.process.smoothness, length, sd)


def process_grid(past: ScaledHistory) -> list[MaternProcess]:
    """Return a few processes, one of which is near to any that is allowed."""
    noise = float(np.median(past.sd))
    sds = [0.7 * noise, 2.0 * noise]
    if noise < 0.3:
        sds.append(0.8)
    shortest = 2.5 * past.gap
    lengths = [length for length in (0.03, 0.15, 0.5) if length > shortest] or [0.5]
    return [
        MaternProcess(0.5, 1.0, 0.0),
        *(
            MaternProcess(smoothness, length, sd)
            for smoothness in (0.5, 1.5)
            for length in lengths
            for sd in sds
        ),
    ]


def process_variants(process: MaternProcess) -> list[MaternProcess]:
    """Return the process with either smoothness, and no process."""
    sd, length = process.sd or 0.1, process.length
    return [
        MaternProcess(0.5, length, sd),
        MaternProcess(1.5, length, sd),
        MaternProcess(0.5, 1.0, 0.0),
    ]


def process_variant(process: MaternProcess) -> tuple[float, bool]:
    """Return what tells variants of a process apart: smoothness, and whether there is one."""
    return process.smoothness, process.sd > 0.0


def log_process_prior(process: MaternProcess) -> float:
    """Log prior probability of the variant of a process [nats]."""
    return float(np.log(0.5 * (1.0 - _NO_PROCESS) if process.sd > 0.0 else _NO_PROCESS))


def fit_variants(
    readings: ScreenedHistory, terms: tuple[Term, ...], process: MaternProcess
) -> LaplaceFit:
    """Fit each variant of the process, and add their evidence up."""
    starts = process_variants(process)
    return add_variants([maximize_evidence(readings, terms, (), start) for start in starts])


def add_variants(fits: Sequence[LaplaceFit]) -> LaplaceFit:
    """Return the best of several fits, with the evidence of all variants of the process."""
    best: dict[tuple[float, bool], float] = {}
    # Of several fits with one variant the best counts.
    for fit in fits:
        key = process_variant(fit.process)
        own = fit.log_evidence + log_process_prior(fit.process)
        best[key] = max(best.get(key, -np.inf), own)
    total = float(np.logaddexp.reduce(list(best.values())))
    return dataclasses.replace(max(fits, key=lambda f: f.log_evidence), log_evidence=total)


def shape_space(
    readings: ScreenedHistory,
    before: tuple[Term, ...],
    free: tuple[Term, ...],
    process: MaternProcess,
) -> ShapeSpace:
    """Return the space of free terms and process; arguments as for `maximize_evidence`."""
    axes = [axis for term in free for axis in term.law.axes]
    box = np.array([[axis.low, axis.high] for axis in axes]).reshape(-1, 2)
    finest = [x for term in free for x in _grain(term)]
    # Half the spacing of the first grid: no farther than the next start.
    steps = [0.5 * float(np.median(np.diff(a.grid))) if len(a.grid) > 1 else 1e-5 for a in axes]
    if process.sd > 0.0:
        box = np.concatenate([box, _process_bounds(readings.past)])
        finest, steps = [*finest, 0.0, 0.0], [*steps, 0.7, 0.7]
    return ShapeSpace(before, free, process, box, np.array(finest), np.array(steps))


def _process_bounds(past: ScaledHistory) -> Float[np.ndarray, "2 2"]:
    """Bounds of the logarithms of standard deviation and length of the process."""
    noise = min(float(np.median(past.sd)), _LARGEST_SD)
    return np.log([[0.15 * noise, _LARGEST_SD], [2.0 * past.gap, _LONGEST_LENGTH]])


def _grain(term: Term) -> tuple[float, ...]:
    if term.law.grain is not None:
        return term.law.grain(term.shape)
    return tuple(axis.finest for axis in term.law.axes)


def maximize_evidence(
    readings: ScreenedHistory,
    before: tuple[Term, ...],
    free: tuple[Term, ...],
    process: MaternProcess,
) -> LaplaceFit:
    """Maximise the evidence from one start, and integrate it around the maximum.

    The integral is the product of the widths of the peak, relative to the ranges: a parameter
    whose peak is as wide as its range costs nothing. Widths are found by walking until the
    evidence has dropped, because some shapes, such as the time of a step, have no derivative.
    """
    space = shape_space(readings, before, free, process)
    score = evidence_function(readings, space)
    point = space.start
    if len(point):
        point = _simplex_search(score, point, space)
    peak = score(point)
    widths = np.array(
        [
            _width(score, point, peak, i, space.box[i], space.finest[i])
            for i in range(len(point))
        ]
    )
    reach = space.box[:, 1] - space.box[:, 0]
    share = np.sqrt(2.0 * np.pi) * widths / np.maximum(reach, 1e-12)
    occam = float(np.log(np.minimum(share, 1.0)).sum())
    return LaplaceFit(
        space.terms_at(point),
        space.process_at(point),
        peak + occam,
        peak,
        tuple(widths.tolist()),
    )


def evidence_function(
    readings: ScreenedHistory, space: ShapeSpace
) -> Callable[[np.ndarray], float]:
    """Return the log-evidence as a function of points of a space; minus infinity outside."""
    past = readings.past
    fixed = design(space.before, past.time, past.covariates)
    shape_count = sum(len(term.law.axes) for term in space.free)
    # Regressors are computed once for each shape, because most steps of a search change only
    # the process.
    drawn: dict[bytes, tuple[np.ndarray, np.ndarray, np.ndarray] | None] = {}

    def draw(terms: tuple[Term, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        free = terms[len(space.before) :]
        if not all(t.law.allows(past.time, past.covariates, t.shape) for t in free):
            return None
        added = (t.columns(past.time, past.covariates) for t in free)
        columns = np.column_stack([fixed, *added])
        priors = design_priors(columns, readings.mask)
        stacked = np.ascontiguousarray(np.column_stack([columns, past.value]))
        return noise_variance(readings, terms), stacked, priors

    @no_type_check
    def score(point: np.ndarray) -> float:
        if (point < space.box[:, 0]).any() or (point > space.box[:, 1]).any():
            return -np.inf
        key = point[:shape_count].tobytes()
        if key not in drawn:
            drawn[key] = draw(space.terms_at(point))
        found = drawn[key]
        if found is None:
            return -np.inf
        process = space.process_at(point)
        return evidence.log_evidence(process, past.steps, *found, readings.count)

    typed: Callable[[np.ndarray], float] = score
    return typed


def _simplex_search(
    score: Callable[[np.ndarray], float], point: np.ndarray, space: ShapeSpace
) -> np.ndarray:
    low, high = space.box.T
    inward = np.where(point + space.steps > high, -space.steps, space.steps)
    simplex = np.concatenate([point[None, :], point + np.diag(inward)])

    @no_type_check
    def cost(at: Point) -> float:
        return min(-score(at), 1e12)

    found = minimize(
        cost,
        point,
        method="Nelder-Mead",
        options={
            "initial_simplex": np.clip(simplex, low, high),
            "maxfev": _EVALUATIONS * (1 + len(point)),
            "xatol": 1e-4,
            "fatol": 0.02,
        },
    )
    best: np.ndarray = found.x
    return best


def _width(
    score: Callable[[np.ndarray], float],
    point: np.ndarray,
    peak: float,
    index: int,
    box: np.ndarray,
    finest: float,
) -> float:
    """Distance over which the evidence drops by 1/2 nat, the mean of both sides."""
    reach = float(box[1] - box[0])
    sides = []
    for direction in (-1.0, 1.0):
        room = float(box[1] - point[index]) if direction > 0.0 else float(point[index] - box[0])
        apart = max(reach / 2000.0, finest)
        while True:
            away = point.copy()
            away[index] += direction * min(apart, room)
            drop = peak - score(away) if room > 0.0 else 0.0
            if drop >= _EVIDENCE_DROP or apart >= room:
                break
            apart *= 2.0
        if drop > 0.05:
            ratio = _EVIDENCE_DROP / max(drop, _EVIDENCE_DROP / 16.0)
            sides.append(min(apart, room) * float(np.sqrt(ratio)))
        else:
            sides.append(room)
    least = max(0.3 * finest, 1e-5 * reach, 1e-12)
    return max(min(float(np.mean(sides)), reach / float(np.sqrt(2.0 * np.pi))), least)

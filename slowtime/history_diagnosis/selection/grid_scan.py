"""Scan of every candidate law over its whole grid of shapes."""

import dataclasses
import itertools

import numpy as np
from jaxtyping import Float

from slowtime.history_diagnosis.data.history import Series
from slowtime.history_diagnosis.laws.catalogue import HistoryLaw, Shape
from slowtime.history_diagnosis.laws.laplace import process_grid
from slowtime.history_diagnosis.laws.terms import (
    ScreenedHistory,
    Term,
    column_priors,
    design,
    design_priors,
    noise_variance,
)
from slowtime.history_diagnosis.likelihood import evidence
from slowtime.history_diagnosis.likelihood.whitening import FilterResult, MaternProcess, whiten

_CHUNK = 512
"""[shapes] Evaluated together. Source: a bound on memory."""
_MANY_SHAPES = 400
"""[shapes] Of a law, beyond which fewer processes are tried. Source: a bound on computing
time."""
_SECOND_START_SHAPES = 4
"""[shapes] Of a law, beyond which the refinement gets a second start. Source:
docs/what_decides.md, which has the cases where it decides."""
_ZOOMS = (1.0, 0.3, 0.08)
"""[grid spacings] Half widths of the finer grids around the best shapes of a multimodal law.
Source: docs/what_decides.md: half and double change no answer."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ScanResult:
    """Evidence of one more term of one law.

    Parameters
    ----------
    score
        Log-evidence, averaged over the grid of shapes, relative to no further term [nats].
    terms, processes
        Its best shapes, and the random process that goes with each.
    """

    law: HistoryLaw
    score: float
    terms: tuple[Term, ...]
    processes: tuple[MaternProcess, ...]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class GridScan:
    """Results for all laws, best first, and the evidence of no further term."""

    nothing: float
    process: MaternProcess
    results: tuple[ScanResult, ...]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Base:
    """Terms that are there already, whitened by each of several processes."""

    readings: ScreenedHistory
    before: tuple[Term, ...]
    columns: Float[np.ndarray, "time coefficient"]
    priors: Float[np.ndarray, " coefficient"]
    variance: Series
    processes: tuple[MaternProcess, ...]
    whitened: tuple[FilterResult, ...]

    def subset(self, chosen: list[int]) -> "_Base":
        """Keep some of the processes."""
        return dataclasses.replace(
            self,
            processes=tuple(self.processes[i] for i in chosen),
            whitened=tuple(self.whitened[i] for i in chosen),
        )


def scan_grid(
    readings: ScreenedHistory, laws: tuple[HistoryLaw, ...], before: tuple[Term, ...]
) -> GridScan:
    """Add each law, in each shape of its grid, to the terms found so far."""
    past = readings.past
    columns = design(before, past.time, past.covariates)
    stacked = np.column_stack([past.value, columns])
    processes = tuple(process_grid(past))
    variance = noise_variance(readings, before)
    whitened = tuple(whiten(process, past.time, variance, stacked) for process in processes)
    priors = design_priors(columns, readings.mask)
    base = _Base(readings, before, columns, priors, variance, processes, whitened)
    nothing = np.array(
        [
            evidence.coefficient_posterior(one, priors, readings.count).log_evidence
            for one in whitened
        ]
    )
    best = int(nothing.argmax())
    few = base.subset(_fewer(processes, best))
    results = [
        _scan_law(few if len(law.grid) > _MANY_SHAPES or not law.width else base, law, nothing)
        for law in laws
        if law.grid
    ]
    results.sort(key=lambda result: -result.score)
    return GridScan(float(nothing[best]), processes[best], tuple(results))


def _fewer(processes: tuple[MaternProcess, ...], best: int) -> list[int]:
    """Choose no process, the best without a further term, and every other quiet one."""
    least = min(p.sd for p in processes if p.sd > 0.0)
    quiet = [p for p in processes if p.sd == least]
    return [
        i
        for i, p in enumerate(processes)
        if p.sd == 0.0 or p == processes[best] or p in quiet[1::2]
    ]


def _scan_law(
    base: _Base, law: HistoryLaw, nothing: Float[np.ndarray, " process"]
) -> ScanResult:
    values = _evidence(base, law, law.grid) if law.width else _noise_law_evidence(base, law)
    best = values.max(axis=0)
    score = float(np.logaddexp.reduce(best) - np.log(len(best))) - float(nothing.max())
    if law.multimodal:
        return _zoom(base, law, values, score)
    chosen = _separate_peaks(best)
    return ScanResult(
        law,
        score,
        tuple(Term(law, law.grid[i]) for i in chosen),
        tuple(base.processes[int(values[:, i].argmax())] for i in chosen),
    )


def _noise_law_evidence(base: _Base, law: HistoryLaw) -> Float[np.ndarray, "process shape"]:
    """Evidence of a law of the noise, which has no regressors: all is filtered again."""
    past = base.readings.past
    stacked = np.column_stack([base.columns, past.value])
    found = np.empty((len(base.processes), len(law.grid)))
    for at, shape in enumerate(law.grid):
        variance = noise_variance(base.readings, (*base.before, Term(law, shape)))
        for i, process in enumerate(base.processes):
            found[i, at] = evidence.log_evidence(
                process, past.steps, variance, stacked, base.priors, base.readings.count
            )
    return found


def _zoom(
    base: _Base, law: HistoryLaw, values: Float[np.ndarray, "process shape"], score: float
) -> ScanResult:
    """Search ever finer grids around the best shape of each process."""
    found = []
    offsets = np.linspace(-1.0, 1.0, 9)
    for i, row in enumerate(values):
        shape, best = law.grid[int(row.argmax())], -np.inf
        for finer in _ZOOMS:
            sides = [
                np.clip(x + finer * np.median(np.diff(a.grid)) * offsets, a.low, a.high)
                for x, a in zip(shape, law.axes, strict=True)
            ]
            near = list(itertools.product(*(side.tolist() for side in sides)))
            scores = _evidence(base.subset([i]), law, near)[0]
            shape, best = near[int(scores.argmax())], float(scores.max())
        found.append((best, Term(law, shape), base.processes[i]))
    found.sort(key=lambda one: -one[0])
    score = max(score, score + found[0][0] - float(values.max()))
    return ScanResult(
        law, score, tuple(one[1] for one in found[:2]), tuple(one[2] for one in found[:2])
    )


def _evidence(
    base: _Base, law: HistoryLaw, shapes: list[Shape]
) -> Float[np.ndarray, "process shape"]:
    chunks = [shapes[first : first + _CHUNK] for first in range(0, len(shapes), _CHUNK)]
    return np.concatenate([_chunk_evidence(base, law, chunk) for chunk in chunks], axis=1)


def _chunk_evidence(
    base: _Base, law: HistoryLaw, shapes: list[Shape]
) -> Float[np.ndarray, "process shape"]:
    readings, past = base.readings, base.readings.past
    drawn = np.stack([law.columns(past.time, past.covariates, s) for s in shapes], axis=1)
    flat = drawn.reshape(len(drawn), -1)
    priors = column_priors(flat, readings.mask).reshape(drawn.shape[1:])
    found = np.empty((len(base.processes), len(shapes)))
    for i, (process, known) in enumerate(zip(base.processes, base.whitened, strict=True)):
        white = whiten(process, past.time, base.variance, flat).white.reshape(drawn.shape)
        found[i] = evidence.log_evidence_of_additions(
            known, base.priors, white, priors, readings.count
        )
    undetermined = [not law.allows(past.time, past.covariates, s) for s in shapes]
    found[:, undetermined] = -np.inf
    return found


def _separate_peaks(score: Float[np.ndarray, " shape"]) -> list[int]:
    """Choose the best shape, and the best that is no neighbour of it."""
    first = int(score.argmax())
    chosen = [first]
    if len(score) > _SECOND_START_SHAPES:
        rest = score.copy()
        rest[max(0, first - 2) : first + 3] = -np.inf
        chosen.append(int(rest.argmax()))
    return chosen

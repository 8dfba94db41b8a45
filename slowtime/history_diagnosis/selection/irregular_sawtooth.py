"""Search for a sawtooth that falls at irregular instants, as by refilling or retightening.

Its shape is a list of instants of any length, which no grid holds. The search starts from the
largest jumps of the readings, takes the most probable number of them, and then moves, removes
and adds falls one at a time while that helps.
"""

import dataclasses
from collections.abc import Callable
from typing import no_type_check

import numpy as np
from jaxtyping import Float

from slowtime.history_diagnosis.data.history import FilledCovariate, ScaledHistory, Series
from slowtime.history_diagnosis.laws import regressors
from slowtime.history_diagnosis.laws.catalogue import HistoryLaw, Shape, ShapeAxis
from slowtime.history_diagnosis.laws.terms import (
    ScreenedHistory,
    Term,
    design,
    design_priors,
    noise_variance,
)
from slowtime.history_diagnosis.likelihood import evidence
from slowtime.history_diagnosis.likelihood.whitening import MaternProcess

from .grid_scan import GridScan, ScanResult

_FEWEST_FALLS = 2
"""[falls] Of a sawtooth at least. Source: one fall is a step."""
_MOST_FALLS = 14
"""[falls] Of a sawtooth at most. Source: a bound on computing time."""
_PASSES = 2
"""[passes] Of moving, removing and adding. Source: a bound on computing time."""
_LEAST_HINT = 3.0
"""[nats] That a law of time must gain before falls are sought. Source: Kass and Raftery (1995)
call 3 nats strong evidence."""
_TIME_FAMILIES = ("step", "sawtooth", "drift", "periodic")


def add_irregular_sawtooth(
    readings: ScreenedHistory, before: tuple[Term, ...], scanned: GridScan
) -> GridScan:
    """Add the best irregular sawtooth to a scan, if there may be one."""
    timed = (r.score for r in scanned.results if r.law.family in _TIME_FAMILIES)
    if max(timed, default=-np.inf) < _LEAST_HINT:
        return scanned
    past = readings.past
    noise_sd = float(np.median(past.sd))
    processes = [MaternProcess(0.5, 1.0, 0.0), MaternProcess(1.5, 0.15, noise_sd)]
    scorers = [_evidence_function(readings, before, process) for process in processes]

    def score(falls: list[float]) -> float:
        price = len(falls) * np.log(len(past.time) * np.e / max(len(falls), 1))
        return max(one(falls) for one in scorers) - float(price)

    found = [_search(past, score, _largest_jumps(readings, sign)) for sign in (-1.0, 1.0)]
    falls = max((f for f in found if len(f) >= _FEWEST_FALLS), key=score, default=None)
    if falls is None:
        return scanned
    law = _law(past, falls)
    best = processes[int(np.argmax([one(falls) for one in scorers]))]
    gain = score(falls) - scanned.nothing
    results = (*scanned.results, ScanResult(law, gain, (Term(law, tuple(falls)),), (best,)))
    ranked = tuple(sorted(results, key=lambda result: -result.score))
    return dataclasses.replace(scanned, results=ranked)


def _evidence_function(
    readings: ScreenedHistory, before: tuple[Term, ...], process: MaternProcess
) -> Callable[[list[float]], float]:
    past = readings.past
    fixed = design(before, past.time, past.covariates)
    steps, variance = past.steps, noise_variance(readings, before)

    @no_type_check
    def score(falls):
        columns = np.column_stack([fixed, regressors.irregular_sawtooth(past.time, falls)])
        priors = design_priors(columns, readings.mask)
        stacked = np.column_stack([columns, past.value])
        return evidence.log_evidence(process, steps, variance, stacked, priors, readings.count)

    typed: Callable[[list[float]], float] = score
    return typed


def _largest_jumps(readings: ScreenedHistory, sign: float) -> list[float]:
    """Instants at which readings of one sign jump most, the largest jump first."""
    past = readings.past
    time, value = past.time[readings.mask], sign * past.value[readings.mask]
    width = max(3, len(time) // 80)
    total = np.concatenate([[0.0], np.cumsum(value)])
    middle = np.arange(width, len(time) - width)
    after = total[middle + width] - total[middle]
    jump = (after - (total[middle] - total[middle - width])) / width
    chosen: list[float] = []
    for i in np.argsort(-jump):
        at = 0.5 * float(time[middle[i]] + time[middle[i] - 1])
        if all(abs(at - other) > width * past.gap for other in chosen):
            chosen.append(at)
        if len(chosen) == _MOST_FALLS:
            break
    return chosen


def _search(
    past: ScaledHistory, score: Callable[[list[float]], float], jumps: list[float]
) -> list[float]:
    """Take the best number of jumps, then move, remove and add falls one at a time."""
    counts = [sorted(jumps[:count]) for count in range(1, len(jumps) + 1)]
    falls = max(counts, key=score)
    between = 0.5 * (past.time[1:] + past.time[:-1])
    for _ in range(_PASSES):
        for place in range(len(falls)):
            at = int(np.searchsorted(between, falls[place]))
            near = between[max(0, at - 6) : at + 7].tolist()
            rest = falls[:place] + falls[place + 1 :]
            falls = max([falls, *(sorted([*rest, b]) for b in near)], key=score)
        fewer = [falls[:i] + falls[i + 1 :] for i in range(len(falls)) if len(falls) > 1]
        more = [sorted([*falls, jump]) for jump in jumps if jump not in falls]
        better = max([falls, *fewer, *more], key=score)
        if better == falls:
            break
        falls = better
    return falls


def _law(past: ScaledHistory, falls: list[float]) -> HistoryLaw:
    # Ordered instants fill the box of each within e/2m of it about as often as all of time.
    half = 0.5 * np.e / len(falls)
    axes = tuple(
        ShapeAxis(
            f"fall {i}", at - half, at + half, np.array([at, at + past.gap]), 0.5 * past.gap
        )
        for i, at in enumerate(falls)
    )

    @no_type_check
    def drawn(
        time: Series, covariate: FilledCovariate | None, shape: Shape
    ) -> Float[np.ndarray, "time 2"]:
        return regressors.irregular_sawtooth(time, list(shape))

    return HistoryLaw("sawtooth", "sawtooth", "irregular", None, axes, drawn, 2)

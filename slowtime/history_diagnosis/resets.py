"""A sawtooth that falls back when it likes: refuelling, refilling, retightening.

Its shape is a list of instants of any length, which no grid holds. So falls are looked for
where the readings themselves jump, the most probable number of them is taken, and each is
moved, left out or joined by another as long as that helps.
"""

import dataclasses
from collections.abc import Callable
from typing import no_type_check

import numpy as np
from jaxtyping import Float

from . import evidence, shapes
from .history import Filled, Scaled, Series
from .kinds import Axis, Kind, Shape
from .law import Readings, Term, design, noise, prior_variance
from .scan import Promise, Scan
from .whitening import Wander, gram

_FEWEST, _MOST = 2, 14
_PASSES = 2
_HINT = 3.0  # of log-evidence that time alone must promise, to look for falls at all
_TIMED = ("step", "sawtooth", "drift", "periodic")


def irregular(readings: Readings, before: tuple[Term, ...], looked: Scan) -> Promise | None:
    """Find the best sawtooth with falls at any instants, where there may be one."""
    hint = max((p.score for p in looked.promises if p.kind.family in _TIMED), default=-np.inf)
    if hint < _HINT:
        return None
    past = readings.past
    noises = float(np.median(past.sd))
    wanders = [Wander(0.5, 1.0, 0.0), Wander(1.5, 0.15, noises)]
    scorers = [_scorer(readings, before, wander) for wander in wanders]

    def score(falls: list[float]) -> float:
        price = len(falls) * np.log(len(past.time) * np.e / max(len(falls), 1))
        return max(one(falls) for one in scorers) - float(price)

    found = [_improved(past, score, _jumps(readings, sign)) for sign in (-1.0, 1.0)]
    falls = max((f for f in found if len(f) >= _FEWEST), key=score, default=None)
    if falls is None:
        return None
    kind = _kind(past, falls)
    best = wanders[int(np.argmax([one(falls) for one in scorers]))]
    return Promise(kind, score(falls) - looked.nothing, (Term(kind, tuple(falls)),), (best,))


def _scorer(
    readings: Readings, before: tuple[Term, ...], wander: Wander
) -> Callable[[list[float]], float]:
    past = readings.past
    fixed = design(before, past.time, past.covariates)
    step, noises = np.diff(past.time, prepend=past.time[0]), noise(readings, before)

    @no_type_check
    def score(falls):
        columns = np.column_stack([fixed, shapes.since(past.time, falls)])
        variance = prior_variance(columns, readings.mask)
        variance[0] = evidence.MEAN_SD**2
        together = np.column_stack([columns, past.value])
        products, determinant = gram(
            wander.smoothness, wander.length, wander.sd, step, noises, together
        )
        return evidence.of_gram(products, determinant, variance, readings.count)

    scored: Callable[[list[float]], float] = score
    return scored


def _jumps(readings: Readings, sign: float) -> list[float]:
    """Instants at which readings of one sign jump most, the greatest jump first."""
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
        if len(chosen) == _MOST:
            break
    return chosen


def _improved(
    past: Scaled, score: Callable[[list[float]], float], jumps: list[float]
) -> list[float]:
    """Take as many jumps as pay, then move, leave out and add one at a time."""
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


def _kind(past: Scaled, falls: list[float]) -> Kind:
    # Instants in order fill the box of each within e/2m of it about as often as all of time.
    half = 0.5 * np.e / len(falls)
    axes = tuple(
        Axis(f"fall {i}", at - half, at + half, np.array([at, at + past.gap]), 0.5 * past.gap)
        for i, at in enumerate(falls)
    )

    @no_type_check
    def draw(time: Series, covariate: Filled | None, shape: Shape) -> Float[np.ndarray, "t 2"]:
        return shapes.since(time, list(shape))

    return Kind("sawtooth", "sawtooth", "irregular", None, axes, draw, 2)


def with_irregular(readings: Readings, before: tuple[Term, ...], looked: Scan) -> Scan:
    """Let the irregular sawtooth take part."""
    found = irregular(readings, before, looked)
    if found is None:
        return looked
    promises = sorted((*looked.promises, found), key=lambda promise: -promise.score)
    return dataclasses.replace(looked, promises=tuple(promises))

"""Every law over its whole grid of shapes, quickly: what is worth a closer look."""

import dataclasses
import itertools

import numpy as np
from jaxtyping import Float

from . import evidence
from .history import Series
from .kinds import Kind, Shape
from .law import Readings, Term, design, noise, prior_variance, settings
from .whitening import Filtered, Wander, gram, whiten

_CHUNK = 512
_MANY = 400  # shapes, beyond which only few wandering parts are tried in the scan
_LENS = np.linspace(-1.0, 1.0, 9)
_ROOM = 4  # shapes, beyond which a second start is taken


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Promise:
    """What one more term of a kind might gain.

    Parameters
    ----------
    kind
        The law.
    score
        Logarithm of the evidence, averaged over the grid of shapes, over that without it.
    terms, wanders
        Its best shapes, and the wandering part that goes with each.
    """

    kind: Kind
    score: float
    terms: tuple[Term, ...]
    wanders: tuple[Wander, ...]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """Promises in descending order, and the evidence of adding nothing."""

    nothing: float
    wander: Wander
    promises: tuple[Promise, ...]


def scan(readings: Readings, kinds: tuple[Kind, ...], before: tuple[Term, ...]) -> Scan:
    """Add each kind, in each shape of its grid, to the terms that are there already."""
    past = readings.past
    columns = design(before, past.time, past.covariates)
    variance = prior_variance(columns, readings.mask)
    variance[0] = evidence.MEAN_SD**2
    together = np.column_stack([past.value, columns])
    wanders = settings(past)
    variances = noise(readings, before)
    bases = [whiten(w, past.time, variances, together) for w in wanders]
    nothing = np.array(
        [evidence.posterior(base, variance, readings.count).log_evidence for base in bases]
    )
    best = int(nothing.argmax())
    floor = float(nothing[best])
    promises = []
    for kind in kinds:
        if not kind.grid:
            continue
        few = _few(wanders, best) if len(kind.grid) > _MANY or not kind.width else wanders
        chosen = [i for i, wander in enumerate(wanders) if wander in few]
        values = _over_grid(
            readings, before, kind, few, [bases[i] for i in chosen], variance, variances
        )
        promise = _promise(kind, few, values, floor)
        if kind.jagged:
            near = [bases[i] for i in chosen]
            promise = _zoomed(promise, readings, few, near, values, variance, variances)
        promises.append(promise)
    promises.sort(key=lambda promise: -promise.score)
    return Scan(floor, wanders[best], tuple(promises))


def _few(wanders: list[Wander], best: int) -> list[Wander]:
    """No wandering, as the readings have it without the new term, and every other in sd."""
    quiet = [w for w in wanders if w.sd == min(v.sd for v in wanders if v.sd > 0.0)]
    return [w for w in wanders if w.sd == 0.0 or w == wanders[best] or w in quiet[1::2]]


def _over_grid(
    readings: Readings,
    before: tuple[Term, ...],
    kind: Kind,
    wanders: list[Wander],
    bases: list[Filtered],
    variance: Float[np.ndarray, " coefficient"],
    noise: Series,
) -> Float[np.ndarray, "wander shape"]:
    grid = kind.grid
    if not kind.width:
        return _louder(readings, before, kind, wanders, variance)
    return np.concatenate(
        [
            _chunk(
                readings, kind, grid[first : first + _CHUNK], wanders, bases, variance, noise
            )
            for first in range(0, len(grid), _CHUNK)
        ],
        axis=1,
    )


def _louder(
    readings: Readings,
    before: tuple[Term, ...],
    kind: Kind,
    wanders: list[Wander],
    variance: Float[np.ndarray, " coefficient"],
) -> Float[np.ndarray, "wander shape"]:
    """Laws of the noise have no columns: the readings are filtered anew for each."""
    past = readings.past
    step = np.diff(past.time, prepend=past.time[0])
    columns = np.column_stack([design(before, past.time, past.covariates), past.value])
    found = np.empty((len(wanders), len(kind.grid)))
    for at, shape in enumerate(kind.grid):
        variances = noise(readings, (*before, Term(kind, shape)))
        for i, wander in enumerate(wanders):
            products, determinant = gram(
                wander.smoothness, wander.length, wander.sd, step, variances, columns
            )
            found[i, at] = evidence.of_gram(products, determinant, variance, readings.count)
    return found


def _promise(
    kind: Kind,
    wanders: list[Wander],
    values: Float[np.ndarray, "wander shape"],
    nothing: float,
) -> Promise:
    best = values.max(axis=0)
    score = float(np.logaddexp.reduce(best) - np.log(len(best))) - nothing
    chosen = _apart(best)
    return Promise(
        kind,
        score,
        tuple(Term(kind, kind.grid[i]) for i in chosen),
        tuple(wanders[int(values[:, i].argmax())] for i in chosen),
    )


def _zoomed(
    promise: Promise,
    readings: Readings,
    wanders: list[Wander],
    bases: list[Filtered],
    values: Float[np.ndarray, "wander shape"],
    variance: Float[np.ndarray, " coefficient"],
    noise: Series,
) -> Promise:
    """Look about the best shapes, those with each wandering part, with ever finer grids."""
    kind = promise.kind
    found = []
    for wander, base, row in zip(wanders, bases, values, strict=True):
        shape, best = kind.grid[int(row.argmax())], -np.inf
        for finer in (1.0, 0.3, 0.08):
            sides = [
                np.clip(x + finer * np.median(np.diff(a.grid)) * _LENS, a.low, a.high).tolist()
                for x, a in zip(shape, kind.axes, strict=True)
            ]
            near = list(itertools.product(*sides))
            scores = _chunk(readings, kind, near, [wander], [base], variance, noise)[0]
            shape, best = near[int(scores.argmax())], float(scores.max())
        found.append((best, Term(kind, shape), wander))
    found.sort(key=lambda one: -one[0])
    score = max(promise.score, promise.score + found[0][0] - float(values.max()))
    return Promise(
        kind, score, tuple(one[1] for one in found[:2]), tuple(one[2] for one in found[:2])
    )


def _chunk(
    readings: Readings,
    kind: Kind,
    shapes: list[Shape],
    wanders: list[Wander],
    bases: list[Filtered],
    variance: Float[np.ndarray, " coefficient"],
    noise: Series,
) -> Float[np.ndarray, "wander shape"]:
    past = readings.past
    drawn = np.stack([kind.columns(past.time, past.covariates, s) for s in shapes], axis=1)
    flat = drawn.reshape(len(drawn), -1)
    prior = prior_variance(flat, readings.mask).reshape(drawn.shape[1:])
    hopeless = np.zeros(len(shapes), dtype=bool)
    if kind.allowed is not None:
        hopeless[:] = [not kind.allows(past.time, past.covariates, s) for s in shapes]
    found = np.empty((len(wanders), len(shapes)))
    for i, (wander, base) in enumerate(zip(wanders, bases, strict=True)):
        white = whiten(wander, past.time, noise, flat).white.reshape(drawn.shape)
        found[i] = evidence.many(base, variance, white, prior, readings.count)
    found[:, hopeless] = -np.inf
    return found


def _apart(score: Float[np.ndarray, " shape"]) -> list[int]:
    """Choose the best shape, and the best that is no neighbour of it."""
    first = int(score.argmax())
    chosen = [first]
    if len(score) > _ROOM:
        rest = score.copy()
        rest[max(0, first - 2) : first + 3] = -np.inf
        chosen.append(int(rest.argmax()))
    return chosen

"""A law put together of terms, fitted to a history: its evidence, its best shapes, how sure."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize

from . import evidence
from .evidence import Posterior
from .history import Filled, Scaled, Series, used
from .kinds import Kind, Shape
from .whitening import Filtered, Wander, gram, whiten

_EVALUATIONS = 25  # for each coordinate, of the search for a peak
_DROP = 0.5  # of the log-evidence, one standard deviation from a Gaussian peak
# Length scale of the wandering part, in histories, and its sd, in that of the readings: what
# takes longer to come back, or went further than was ever seen, is a drift.
_LONGEST, _WIDEST = 0.6, 2.0
_FLATTEST = 0.01  # variance of a column, below which its coefficient is not let grow on
_WHITE = 0.3  # prior probability that nothing wanders


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Term:
    """One law with its shape."""

    kind: Kind
    shape: Shape

    def columns(self, time: Series, covariates: tuple[Filled, ...]) -> np.ndarray:
        """Values at epochs, one column for each coefficient."""
        drawn: np.ndarray = self.kind.columns(time, covariates, self.shape)
        return drawn


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """A history with what of it is used, and how noisy it is.

    Parameters
    ----------
    past
        The history, scaled.
    mask
        Which readings are used.
    variance
        Of the noise of each, as stated, and of what gaps of covariates add.
    barred
        Readings that are known to be wrong and are never used again.
    """

    past: Scaled
    mask: Bool[np.ndarray, " time"]
    variance: Series
    barred: Bool[np.ndarray, " time"]

    @property
    def count(self) -> int:
        """Readings used."""
        return int(self.mask.sum())


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A law at its most probable.

    Parameters
    ----------
    terms, wander
        What it is made of.
    log_evidence
        Shapes and wandering integrated over, relative to other laws of the same readings.
    peak
        The same at the best shapes and wandering alone.
    spreads
        What each shape parameter, and then logarithms of sd and length of the wandering
        part, may be wrong by.
    """

    terms: tuple[Term, ...]
    wander: Wander
    log_evidence: float
    peak: float
    spreads: tuple[float, ...]


def design(
    terms: tuple[Term, ...], time: Series, covariates: tuple[Filled, ...]
) -> Float[np.ndarray, "time coefficient"]:
    """Constant and columns of all terms."""
    columns: Float[np.ndarray, "time coefficient"] = np.column_stack(
        [np.ones(len(time)), *(t.columns(time, covariates) for t in terms)]
    )
    return columns


def prior_variance(
    columns: Float[np.ndarray, "time column"], mask: Bool[np.ndarray, " time"]
) -> Float[np.ndarray, " column"]:
    """Let one column explain all the scatter of the readings, which is 1, and no more."""
    widths: Float[np.ndarray, " column"] = 1.0 / np.maximum(
        np.var(columns[mask], axis=0), _FLATTEST
    )
    return widths


def solve(
    readings: Readings, terms: tuple[Term, ...], wander: Wander
) -> tuple[Posterior, Filtered]:
    """Filter the readings and the columns of a law, and integrate the coefficients out."""
    past = readings.past
    columns = design(terms, past.time, past.covariates)
    variance = prior_variance(columns, readings.mask)
    variance[0] = evidence.MEAN_SD**2
    together = np.column_stack([past.value, columns])
    filtered = whiten(wander, past.time, noise(readings, terms), together)
    return evidence.posterior(filtered, variance, readings.count), filtered


def noise(readings: Readings, terms: tuple[Term, ...]) -> Series:
    """Variances with what terms make of them, infinite where a reading is not used."""
    variance = readings.variance
    for term in terms:
        variance = variance * term.kind.factor(readings.past.time, term.shape)
    return used(readings.mask, variance)


def ranges(past: Scaled) -> Float[np.ndarray, "2 2"]:
    """Least and greatest logarithm of sd, and of length, of the wandering part."""
    noise = min(float(np.median(past.sd)), _WIDEST)
    return np.log([[0.15 * noise, _WIDEST], [2.0 * past.gap, _LONGEST]])


def settings(past: Scaled) -> list[Wander]:
    """Few wandering parts that between them are near to any that is allowed."""
    noise = float(np.median(past.sd))
    sds = [0.7 * noise, 2.0 * noise]
    if noise < 0.3:
        sds.append(0.8)
    shortest = 2.5 * past.gap
    lengths = [length for length in (0.03, 0.15, 0.5) if length > shortest] or [0.5]
    return [
        Wander(0.5, 1.0, 0.0),
        *(Wander(s, length, sd) for s in (0.5, 1.5) for length in lengths for sd in sds),
    ]


def refine(
    readings: Readings,
    before: tuple[Term, ...],
    starts: Sequence[tuple[tuple[Term, ...], Wander]],
) -> Fit:
    """Improve the shapes of more terms and the wandering part together, from each start.

    The evidence integrates over both by their widths at the peak, one after the other; what is
    as wide as its range costs nothing. Widths are found by walking until the evidence has
    dropped, which needs no derivatives: some shapes have none, like the time of a step.
    """
    found = [climb(readings, before, free, start) for free, start in starts]
    best = max(found, key=lambda fit: fit.log_evidence)
    return dataclasses.replace(best, log_evidence=together(found))


def smoothnesses(wander: Wander) -> list[Wander]:
    """Give a wandering part, its like of the other smoothness, and none."""
    sd = wander.sd or 0.1
    rough, smooth = Wander(0.5, wander.length, sd), Wander(1.5, wander.length, sd)
    return [rough, smooth, Wander(0.5, 1.0, 0.0)]


def log_prior(wander: Wander) -> float:
    """Of its smoothness, or of there being none."""
    return float(np.log(0.5 * (1.0 - _WHITE) if wander.sd > 0.0 else _WHITE))


def together(found: Sequence[Fit]) -> float:
    """Sum the evidence over smoothnesses; of several starts of one, the best stands for it."""
    best: dict[tuple[float, bool], float] = {}
    for fit in found:
        key = (fit.wander.smoothness, fit.wander.sd > 0.0)
        best[key] = max(best.get(key, -np.inf), fit.log_evidence + log_prior(fit.wander))
    return float(np.logaddexp.reduce(list(best.values())))


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Space:
    """The shapes of some terms and the wandering part as one point in a box.

    Parameters
    ----------
    before
        Terms whose shapes stay.
    free, wander
        Those that move, and the wandering part, whose smoothness stays.
    box, finest, steps
        Of each coordinate: its range, what is too fine to matter, and the first step.
    """

    before: tuple[Term, ...]
    free: tuple[Term, ...]
    wander: Wander
    box: Float[np.ndarray, "coordinate 2"]
    finest: Float[np.ndarray, " coordinate"]
    steps: Float[np.ndarray, " coordinate"]

    @property
    def start(self) -> Float[np.ndarray, " coordinate"]:
        """Where it was when the space was made."""
        point = [x for term in self.free for x in term.shape]
        if self.wander.sd > 0.0:
            point += [np.log(self.wander.sd), np.log(self.wander.length)]
        inside: Float[np.ndarray, " coordinate"] = np.clip(
            np.array(point, dtype=float), self.box[:, 0], self.box[:, 1]
        )
        return inside

    @no_type_check
    def build(self, point: Float[np.ndarray, " coordinate"]) -> tuple[tuple[Term, ...], Wander]:
        """Terms and wandering part at a point."""
        terms, at = list(self.before), 0
        for term in self.free:
            width = len(term.kind.axes)
            terms.append(Term(term.kind, tuple(point[at : at + width].tolist())))
            at += width
        if self.wander.sd == 0.0:
            return tuple(terms), self.wander
        sd, length = np.exp(point[at:])
        return tuple(terms), Wander(self.wander.smoothness, float(length), float(sd))


def space(
    readings: Readings, before: tuple[Term, ...], free: tuple[Term, ...], wander: Wander
) -> Space:
    """Coordinates of free terms and of the wandering part."""
    axes = [axis for term in free for axis in term.kind.axes]
    box = np.array([[axis.low, axis.high] for axis in axes]).reshape(-1, 2)
    finest = [x for term in free for x in _grain(term)]
    # Half the spacing of the first grid: no farther than the next start.
    steps = [0.5 * float(np.median(np.diff(a.grid))) if len(a.grid) > 1 else 1e-5 for a in axes]
    if wander.sd > 0.0:
        box = np.concatenate([box, ranges(readings.past)])
        finest, steps = [*finest, 0.0, 0.0], [*steps, 0.7, 0.7]
    return Space(before, free, wander, box, np.array(finest), np.array(steps))


def _grain(term: Term) -> tuple[float, ...]:
    if term.kind.grain is not None:
        return term.kind.grain(term.shape)
    return tuple(axis.finest for axis in term.kind.axes)


def climb(
    readings: Readings, before: tuple[Term, ...], free: tuple[Term, ...], wander: Wander
) -> Fit:
    """Best point near a start, and how wide the peak is."""
    room = space(readings, before, free, wander)
    score = scorer(readings, room)
    point = room.start
    if len(point):
        point = _simplex(score, point, room)
    peak = score(point)
    widths = np.array(
        [_width(score, point, peak, i, room.box[i], room.finest[i]) for i in range(len(point))]
    )
    reach = room.box[:, 1] - room.box[:, 0]
    share = np.sqrt(2.0 * np.pi) * widths / np.maximum(reach, 1e-12)
    occam = float(np.log(np.minimum(share, 1.0)).sum())
    terms, best = room.build(point)
    return Fit(terms, best, peak + occam, peak, tuple(widths.tolist()))


def scorer(readings: Readings, room: Space) -> Callable[[np.ndarray], float]:
    """Log-evidence at points of a space, minus infinity outside its box.

    Columns are drawn once for each shape: most steps of a search move the wandering part.
    """
    past = readings.past
    step = np.diff(past.time, prepend=past.time[0])
    fixed = design(room.before, past.time, past.covariates)
    shape_count = sum(len(term.kind.axes) for term in room.free)
    wanders, smoothness = room.wander.sd > 0.0, room.wander.smoothness
    still = room.wander.sd, room.wander.length
    drawn: dict[bytes, tuple[np.ndarray, np.ndarray, np.ndarray] | None] = {}

    def draw(terms: tuple[Term, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        free = terms[len(room.before) :]
        if not all(t.kind.allows(past.time, past.covariates, t.shape) for t in free):
            return None
        columns = np.column_stack(
            [fixed, *(t.columns(past.time, past.covariates) for t in free)]
        )
        variance = prior_variance(columns, readings.mask)
        variance[0] = evidence.MEAN_SD**2
        together = np.column_stack([columns, past.value])
        return np.ascontiguousarray(together), variance, noise(readings, terms)

    @no_type_check
    def score(point: np.ndarray) -> float:
        if (point < room.box[:, 0]).any() or (point > room.box[:, 1]).any():
            return -np.inf
        key = point[:shape_count].tobytes()
        if key not in drawn:
            drawn[key] = draw(room.build(point)[0])
        found = drawn[key]
        if found is None:
            return -np.inf
        columns, variance, noises = found
        sd, length = np.exp(point[shape_count:]) if wanders else still
        products, determinant = gram(smoothness, length, sd, step, noises, columns)
        return evidence.of_gram(products, determinant, variance, readings.count)

    scored: Callable[[np.ndarray], float] = score
    return scored


def _simplex(
    score: Callable[[np.ndarray], float], point: np.ndarray, room: Space
) -> np.ndarray:
    low, high = room.box.T
    inward = np.where(point + room.steps > high, -room.steps, room.steps)
    simplex = np.concatenate([point[None, :], point + np.diag(inward)])

    @no_type_check
    def cost(at: Float[np.ndarray, " coordinate"]) -> float:
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
    """Distance over which the evidence drops by 1/2, the mean of both sides."""
    reach = float(box[1] - box[0])
    sides = []
    for direction in (-1.0, 1.0):
        room = float(box[1] - point[index]) if direction > 0.0 else float(point[index] - box[0])
        apart = max(reach / 2000.0, finest)
        while True:
            away = point.copy()
            away[index] += direction * min(apart, room)
            drop = peak - score(away) if room > 0.0 else 0.0
            if drop >= _DROP or apart >= room:
                break
            apart *= 2.0
        if drop > 0.05:
            sides.append(min(apart, room) * float(np.sqrt(_DROP / max(drop, _DROP / 16.0))))
        else:
            sides.append(room)
    least = max(0.3 * finest, 1e-5 * reach, 1e-12)
    return max(min(float(np.mean(sides)), reach / float(np.sqrt(2.0 * np.pi))), least)

"""Effects found one by one: each against all others, and against nothing more."""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

from .evidence import Posterior
from .kinds import Kind
from .law import (
    Fit,
    Readings,
    Term,
    climb,
    design,
    refine,
    smoothnesses,
    solve,
    together,
)
from .outliers import agreeing
from .resets import with_irregular
from .scan import Promise, Scan, scan
from .whitening import Filtered

_NOTHING = 0.5  # prior probability that there is nothing more to find
# Weight of a family beside the others: everything ages, cracks are rare.
_WEIGHT = {"drift": 3.0, "crack": 0.2, "sensor": 0.5}
_WORTH = 9.0  # of log-evidence behind the most promising, beyond which none is looked at
_HOPELESS = 7.0
_FEW = 3  # readings on which no discovery may hang
_STILL = 3.0  # of log-evidence that must be left without them
_PATIENCE = 2
_LEAST = 3
_MOST = 9
_CLAIM = 0.9  # probability of anything at all, from which on a discovery is claimed


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Option:
    """One answer to what is missing, and how probable it is beside the others.

    Parameters
    ----------
    fit
        All terms with it; the terms before it alone for nothing more.
    kind
        The law that was added; None for nothing.
    probability
        Over all options of one contest.
    """

    fit: Fit
    kind: Kind | None
    probability: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Contest:
    """All options for one more term, most probable first."""

    options: tuple[Option, ...]

    @property
    def nothing(self) -> Option:
        """That nothing is missing."""
        return next(option for option in self.options if option.kind is None)

    def by_name(self) -> list[tuple[str, int | None, float, Option]]:
        """Name, covariate, probability and best option of each law, variants together."""
        sums: dict[tuple[str, int | None], float] = {}
        best: dict[tuple[str, int | None], Option] = {}
        for option in self.options:
            if option.kind is None:
                continue
            key = (option.kind.name, option.kind.covariate)
            sums[key] = sums.get(key, 0.0) + option.probability
            best.setdefault(key, option)
        ranked = sorted(sums, key=lambda key: -sums[key])
        return [(*key, sums[key], best[key]) for key in ranked]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What the search ends with.

    Parameters
    ----------
    readings
        With what was found to be outlying left out.
    nominal, augmented
        Without any term, and with all of them.
    contests
        One for each term of `augmented`: what else could stand in its place.
    last
        The contest in which nothing more was found.
    """

    readings: Readings
    nominal: Fit
    augmented: Fit
    contests: tuple[Contest, ...]
    last: Contest


def search(
    readings: Readings,
    kinds: tuple[Kind, ...],
    most: int,
    progress: Callable[[str, float], None],
) -> Found:
    """Add terms as long as the evidence asks for one; then ask of each whether it is right."""
    contests: list[Contest] = []
    terms: tuple[Term, ...] = ()
    while True:
        progress("searching", len(terms) / (most + 1.0))
        readings, last = _sound(readings, kinds, terms)
        if len(terms) >= most or last.nothing.probability > 1.0 - _CLAIM:
            break
        terms = last.by_name()[0][3].fit.terms
        contests.append(last)
        readings = settle(readings, terms, last.by_name()[0][3].fit)
        if len(terms) > 1:
            terms, contests = _reconsider(readings, kinds, terms, contests)
    progress("fitting", most / (most + 1.0))
    nominal = refine(readings, (), [((), w) for w in smoothnesses(last.nothing.fit.wander)])
    augmented = last.nothing.fit if terms else nominal
    return Found(readings, nominal, augmented, tuple(contests), last)


def contest(readings: Readings, kinds: tuple[Kind, ...], before: tuple[Term, ...]) -> Contest:
    """Let every law compete for being the next term, and nothing more with them."""
    looked = with_irregular(readings, before, scan(readings, kinds, before))
    nothing = refine(readings, before, [((), w) for w in smoothnesses(looked.wander)])
    fits: list[tuple[Kind | None, Fit]] = [(None, nothing)]
    for promise, first in _worth(readings, before, looked):
        fits.append((promise.kind, _all_smoothnesses(readings, before, first)))
    weights = np.array([_log_prior(kind, kinds) + fit.log_evidence for kind, fit in fits])
    shares = np.exp(weights - weights.max())
    shares /= shares.sum()
    options = [Option(f, k, float(p)) for (k, f), p in zip(fits, shares, strict=True)]
    return Contest(tuple(sorted(options, key=lambda option: -option.probability)))


def _sound(
    readings: Readings, kinds: tuple[Kind, ...], before: tuple[Term, ...]
) -> tuple[Readings, Contest]:
    """Hold a contest whose winner does not hang on a handful of readings.

    A wrong reading on an uncommon day is explained by any law of that day. If without the few
    readings that speak most for the winner it is no better than nothing, they are left out.
    """
    found = contest(readings, kinds, before)
    for _ in range(_PATIENCE):
        winner = found.options[0]
        if winner.kind is None or not winner.kind.width:
            break
        loud = _spokesmen(readings, found.nothing.fit, winner.fit)
        without = dataclasses.replace(readings, mask=readings.mask & ~loud)
        quiet = climb(without, before, (), found.nothing.fit.wander)
        still = climb(without, before, winner.fit.terms[-1:], winner.fit.wander)
        if still.log_evidence - quiet.log_evidence > _STILL:
            break
        readings = dataclasses.replace(without, barred=readings.barred | loud)
        found = contest(readings, kinds, before)
    return readings, found


def _spokesmen(readings: Readings, nothing: Fit, winner: Fit) -> Bool[np.ndarray, " time"]:
    """Find the few readings that the winner foretells better than nothing by the most."""
    known, without = (solve(readings, fit.terms, fit.wander) for fit in (winner, nothing))
    gain = _surprise(*without) - _surprise(*known)
    loud = np.zeros(len(gain), dtype=bool)
    loud[np.argsort(gain)[-_FEW:]] = True
    return loud


def _surprise(found: Posterior, filtered: Filtered) -> Float[np.ndarray, " time"]:
    residual: Float[np.ndarray, " time"] = (
        filtered.white[:, 0] - filtered.white[:, 1:] @ found.mean
    )
    return residual**2 / found.noise_variance


def settle(readings: Readings, terms: tuple[Term, ...], fit: Fit) -> Readings:
    """Judge anew which readings are outliers, and what gaps of covariates add to the noise."""
    past = readings.past
    columns = design(terms, past.time, past.covariates)
    mask = agreeing(past, columns[:, 1:], readings.barred)
    mean = solve(readings, terms, fit.wander)[0].mean
    variance = past.sd**2
    for index, covariate in enumerate(past.covariates):
        if not covariate.sd.any():
            continue
        nudged = list(past.covariates)
        nudged[index] = dataclasses.replace(covariate, values=covariate.values + covariate.sd)
        moved = design(terms, past.time, tuple(nudged)) - columns
        variance = variance + (moved @ mean) ** 2
    return Readings(past, mask, variance, readings.barred)


def _reconsider(
    readings: Readings,
    kinds: tuple[Kind, ...],
    terms: tuple[Term, ...],
    contests: list[Contest],
) -> tuple[tuple[Term, ...], list[Contest]]:
    """Ask of each earlier term whether another would do better now, or none."""
    kept, asked = list(terms), list(contests)
    for _ in range(len(terms) - 1):
        old = kept[0]
        rest = tuple(kept[1:])
        again = contest(readings, kinds, rest)
        del kept[0], asked[0]
        if again.nothing.probability > 0.5:
            continue
        name, covariate, probability, best = again.by_name()[0]
        same = (name, covariate) == (old.kind.name, old.kind.covariate)
        if not same and probability < 0.8:
            own = [
                o
                for n, c, _, o in again.by_name()
                if (n, c) == (old.kind.name, old.kind.covariate)
            ]
            best = own[0] if own else best
        kept.append(best.fit.terms[-1])
        asked.append(again)
    # The last found comes first now; turned round so that order of finding is kept.
    return (*kept[1:], kept[0]), [*asked[1:], asked[0]]


def _worth(
    readings: Readings, before: tuple[Term, ...], looked: Scan
) -> list[tuple[Promise, Fit]]:
    """Refine the most promising once, and keep what is not hopelessly behind."""
    near = [p for p in looked.promises if p.score > looked.promises[0].score - _WORTH]
    first = []
    for promise in looked.promises[: max(_LEAST, min(len(near), _MOST))]:
        starts = zip(promise.terms, promise.wanders, strict=True)
        fits = [climb(readings, before, (term,), wander) for term, wander in starts]
        first.append((promise, max(fits, key=lambda fit: fit.log_evidence)))
    best = max(fit.log_evidence for _, fit in first)
    return [(p, fit) for p, fit in first if fit.log_evidence > best - _HOPELESS]


def _all_smoothnesses(readings: Readings, before: tuple[Term, ...], first: Fit) -> Fit:
    """Start anew from a refined shape, with each kind of wandering there is."""
    fits = [first]
    for wander in smoothnesses(first.wander):
        if (wander.smoothness, wander.sd > 0.0) != (
            first.wander.smoothness,
            first.wander.sd > 0.0,
        ):
            fits.append(climb(readings, before, first.terms[-1:], wander))
    best = max(fits, key=lambda fit: fit.log_evidence)
    return dataclasses.replace(best, log_evidence=together(fits))


def _log_prior(kind: Kind | None, kinds: tuple[Kind, ...]) -> float:
    """Nothing and something alike; families by their weight; within a family all alike."""
    if kind is None:
        return float(np.log(_NOTHING))
    families = {k.family for k in kinds}
    total = sum(_WEIGHT.get(family, 1.0) for family in families)
    share = _WEIGHT.get(kind.family, 1.0) / total
    members = sum(k.family == kind.family for k in kinds)
    return float(np.log((1.0 - _NOTHING) * share / members))

"""Pairs of laws that may be missing together, in; an account that begins with both, out."""

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import Fit, refit
from slowtime.discrepancy.calibration.augmentation import carry_effect
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.candidates.law_pairs import law_pairs
from slowtime.discrepancy.candidates.library_fit import Candidate, Label, label_of
from slowtime.discrepancy.diagnosis import Rival
from slowtime.discrepancy.estimation.candidate_fit import (
    FittedCandidate,
    evidence,
    fit_candidate,
    fitted_effect,
    misfit,
)
from slowtime.discrepancy.estimation.input_hold import Hold
from slowtime.discrepancy.estimation.switching_instant import refine_switching_instant
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import moved_of
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.selection.acceptance import accept
from slowtime.discrepancy.selection.many_laws import variable_of
from slowtime.discrepancy.selection.probabilities import answer_of, hardly_any, shares_of
from slowtime.discrepancy.state import Found
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Kind

from .delayed_input import seen_beside_late

SOME, AMONG, TURNS = 0.7, 5, 3
"""Share of what was missing that a law may leave, and be one of two; the best of how many such
are taken two by two, and how many pairs at a time."""
NEAR = 0.1
"""Share of what the best alone leaves, from which a pair is fitted on where it ended."""

Pair = tuple[Candidate, Candidate]


class JointPairs:
    """Begins with two laws at once, where both leave nothing and the best of all leaves much.

    Nor may they need constants that are off: two that are wrong find help in those.

    No pair is tried twice.

    Parameters
    ----------
    before
        The fit that they are added to.
    stated
        What the model says of its inputs between samples; as it stands where not given.
    asked
        Under which holds effects were looked for already.
    """

    def __init__(
        self,
        before: Fit,
        trials: tuple[Trial, ...],
        kinds: Mapping[str, Kind],
        stated: tuple[Hold, ...] | None,
        asked: Sequence[tuple[Hold, ...] | None],
        tell: Monitor,
    ) -> None:
        self._before, self._trials, self._kinds = before, trials, kinds
        self._stated, self._asked, self._tell = stated, asked, tell
        self._done: set[frozenset[Label]] = set()

    def __call__(self, found: Found) -> Found | None:
        """Give an account with two laws, of what was located, tried and refitted so far."""
        best = found.named[0].fit if found.named else self._before
        if (
            best.chi2_in_band < LIMITS.explained_chi2
            or chi2_p_value(best) > LIMITS.coloured_p_value
        ):
            return None
        return self._begun(found, self._pairs(found), NEAR * best.chi2_in_band)

    def beside_late(self, found: Found) -> Found | None:
        """Give an account with a late input and a law that is seen only beside that."""
        late = seen_beside_late(self._before, found.tried, self._trials, self._kinds)
        return self._begun(found, self._new(late), NEAR * self._before.chi2_in_band)

    def _begun(self, found: Found, pairs: Iterator[Pair], near: float) -> Found | None:
        """Fit pairs; give an account with the best that leaves nothing."""
        good: list[tuple[Candidate, FittedCandidate]] = []
        for one, other in pairs:
            if self._tell.is_late:
                break
            self._tell(f"refitting {one.effect.kind} and {other.effect.kind}", 0.35)
            both = self._refitted(one, other, good, near)
            first = found.fits[0]
            if both is None or moved_of(both.fit):
                continue  # what is missing bends no constant
            if both.fit.chi2_in_band < LIMITS.explained_chi2 or hardly_any(both.fit, first):
                good.append((one, both))
        good.sort(key=lambda pair: -pair[1].score)
        return self._accepted(found, good) if good else None

    def _pairs(self, found: Found) -> Iterator[Pair]:
        """Give pairs of one force first, then those of which each explains something alone."""
        assert found.located is not None
        reached = {
            label_of(one.effect): misfit(one.fit, self._before.noise, self._trials)
            for one in found.named
        }
        of_one = law_pairs(self._before, found.located, found.tried, reached, self._kinds)
        yield from self._new(of_one)
        if found.named and found.named[0].fit.chi2_in_band > LIMITS.far_off_chi2:
            of_two = self._new(of_refitted(found, self._kinds))
            yield from itertools.islice(of_two, TURNS)

    def _new(self, every: Iterator[Pair] | Sequence[Pair]) -> Iterator[Pair]:
        for pair in every:
            label = frozenset(label_of(one.effect) for one in pair)
            if label not in self._done:
                self._done.add(label)
                yield pair

    def _refitted(
        self,
        one: Candidate,
        other: Candidate,
        good: Sequence[tuple[Candidate, FittedCandidate]],
        near: float,
    ) -> FittedCandidate | None:
        known = carry_effect(self._before, one.effect, self._kinds)
        noise = good[0][1].fit.noise if good else None
        enough = LIMITS.explained_chi2 * self._before.data
        both = fit_candidate(
            known, other.effect, self._trials, self._kinds, noise, enough,
            start=other.start, late=lambda: self._tell.is_late,
        )  # fmt: skip
        if both is None or not LIMITS.explained_chi2 < both.fit.chi2_in_band < near:
            return both
        return _fitted_on(both, self._trials, self._kinds)

    def _accepted(
        self, found: Found, good: Sequence[tuple[Candidate, FittedCandidate]]
    ) -> Found | None:
        one, both = good[0]
        alone = fit_candidate(
            self._before, one.effect, self._trials, self._kinds, both.fit.noise
        )
        if alone is None:
            return None
        branch = Found(
            [found.fits[0], alone.fit],
            found.trials,
            located=found.located,
            named=found.named,
            tried=found.tried,
        )
        branch.answers.append(answer_of([alone], [1.0], self._kinds))
        kinds = self._kinds
        if not accept(
            branch, alone.fit, [both], self._trials, kinds, self._stated,
            pulled=False, asked=self._asked,
        ):  # fmt: skip
            found.otherwise = branch.otherwise
            return None
        _share(
            branch,
            kinds,
            [(label_of(first.effect), label_of(named.effect)) for first, named in good],
            [named for _, named in good],
        )
        return branch


def _fitted_on(
    both: FittedCandidate, trials: Sequence[Trial], kinds: Mapping[str, Kind]
) -> FittedCandidate:
    """Fit a pair on from where it was given up, and from a better instant of its switch.

    One that is right ends a moment beside that.
    """
    fit = both.fit
    try:
        fit = refit(fit.plant, trials, values=fit.values, states=fit.states, horizons=(1.0,))
        fit = refine_switching_instant(fit, trials, kinds, None, math.inf)
    except (np.linalg.LinAlgError, FloatingPointError):
        return both
    return dataclasses.replace(both, fit=fit, score=evidence(fit, kinds))


def of_refitted(found: Found, kinds: Mapping[str, Kind]) -> Iterator[Pair]:
    """Give laws two by two that each explain something alone, the best first.

    None that may be pieces of one curve: any curve has such.
    """
    bar = SOME * found.fits[-1].chi2_in_band
    some = [one for one in found.named if one.fit.chi2_in_band < bar][:AMONG]
    effects = [fitted_effect(one) for one in some]
    numbers = itertools.combinations(range(len(effects)), 2)
    for i, j in sorted(numbers, key=sum):
        one, other = effects[i], effects[j]
        own = variable_of(one, kinds)
        pieces = own is not None and own == variable_of(other, kinds)
        if one.place == other.place and (pieces or one.kind == other.kind):
            continue
        yield Candidate(one, 0.0, 0.0, 0.0), Candidate(other, 0.0, 0.0, 0.0)


def _share(
    found: Found,
    kinds: Mapping[str, Kind],
    pairs: Sequence[tuple[Label, Label]],
    named: Sequence[FittedCandidate],
) -> None:
    """Give each of two laws the probability of all pairs that it is one of."""
    shares = shares_of(named, kinds)
    for number, answer in enumerate(found.answers):
        label = label_of(answer.effect)
        rivals = tuple(
            Rival(*other, share)
            for pair, share in zip(pairs, shares, strict=True)
            for other in pair
            if label not in pair and other not in pairs[0] and share > LIMITS.told_probability
        )
        sure = sum(s for pair, s in zip(pairs, shares, strict=True) if label in pair)
        found.answers[number] = dataclasses.replace(answer, probability=sure, rivals=rivals)
        if sure < LIMITS.decided_probability and not found.undecided:
            found.undecided = (Rival(*label, sure), *rivals)
            found.pair = tuple(named[:2])

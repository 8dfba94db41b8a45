"""Proposer: two laws that are missing together, of which neither explains much alone."""

import dataclasses
import itertools
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

from slowtime.discrepancy.calibration import Fit, FitControl, try_refit
from slowtime.discrepancy.calibration.augmentation import carry_effect
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.candidates.law_pairs import law_pairs
from slowtime.discrepancy.candidates.library_fit import Candidate, Label, label_of
from slowtime.discrepancy.diagnosis import Rival
from slowtime.discrepancy.estimation.candidate_fit import FitSchedule, fit_candidate
from slowtime.discrepancy.estimation.input_hold import Hold
from slowtime.discrepancy.estimation.model_evidence import (
    FittedCandidate,
    evidence,
    fitted_effect,
    misfit,
)
from slowtime.discrepancy.estimation.switching_instant import refine_switching_instant
from slowtime.discrepancy.hypothesis import Hypothesis, SearchStep
from slowtime.discrepancy.quoting import moved_of
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.selection.acceptance import Criteria, accept
from slowtime.discrepancy.selection.many_laws import variable_of
from slowtime.discrepancy.selection.probabilities import answer_of, hardly_any, shares_of
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, Kind

from .protocol import Round

MAX_SINGLE_REST = 0.7
"""[share of the mean square in band without a law] That a law leaves at most to be one of two.
Source: docs/what_decides.md: half and double change no answer."""
PAIRED_LAWS = 5
"""[laws] The best of those, which are paired with each other. Source: a bound on computing
time."""
MAX_NEW_PAIRS = 3
"""[pairs] That are fitted after each proposer. Source: a bound on computing time."""
NEAR_PAIR_SHARE = 0.1
"""[share of what the best law alone leaves] Below which the fit of a pair is continued from
where it ended. Source: docs/decisions/0030 for the rule; docs/what_decides.md for the value:
half and double change no answer."""

LawPair = tuple[Candidate, Candidate]
PairLabel = frozenset[Label]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class JointPairs:
    """Fits two laws at once, where either leaves much and both leave nothing.

    Both may not need constants that are off: two that are wrong find help in those.
    """

    stated: tuple[Hold, ...] | None
    asked: Sequence[tuple[Hold, ...] | None]

    def of_round(self, given: Round, done: Collection[PairLabel]) -> list[LawPair]:
        """Give pairs of one force first, then those of which each explains something alone."""
        fitted = sorted(given.fitted, key=lambda one: -one.score)
        best = fitted[0].fit if fitted else given.before
        if (
            best.chi2_in_band < LIMITS.explained_chi2
            or chi2_p_value(best) > LIMITS.coloured_p_value
        ):
            return []
        reached = {
            label_of(one.effect): misfit(one.fit, given.before.noise, given.trials)
            for one in fitted
        }
        of_one = law_pairs(given.before, given.localized, given.tried, reached, given.kinds)
        pairs = list(_not_done(of_one, done))
        if fitted and fitted[0].fit.chi2_in_band > LIMITS.far_off_chi2:
            known = {*done, *map(label_of_pair, pairs)}
            of_two = _pairs_of_fitted(fitted, given.hypothesis.last, given.kinds)
            pairs += itertools.islice(_not_done(of_two, known), MAX_NEW_PAIRS)
        return pairs

    def __call__(
        self, given: Round, pairs: Sequence[LawPair], reached: float
    ) -> SearchStep | None:
        """Fit pairs; give the hypothesis with the best that leaves nothing.

        The step adds two effects, or none and suggests a hold; None where no pair leaves less
        than `reached`, the mean square in band of the best law alone, or where none explains.
        """
        good: list[tuple[Candidate, FittedCandidate]] = []
        for one, other in pairs:
            if given.monitor.is_late:
                break
            given.monitor(f"refitting {one.effect.kind} and {other.effect.kind}", 0.35)
            both = _fit_pair(given, one, other, good, NEAR_PAIR_SHARE * reached)
            if both is None or moved_of(both.fit):
                continue  # what is missing bends no constant
            first = given.hypothesis.first
            if both.fit.chi2_in_band < LIMITS.explained_chi2 or hardly_any(both.fit, first):
                good.append((one, both))
        good = without_imitations(good, given.kinds)
        good.sort(key=lambda pair: -pair[1].score)
        return self._accepted(given, good) if good else None

    def _accepted(
        self, given: Round, good: Sequence[tuple[Candidate, FittedCandidate]]
    ) -> SearchStep | None:
        (one, both), kinds = good[0], given.kinds
        alone = fit_candidate(given.before, one.effect, given.trials, kinds, both.fit.noise)
        if alone is None:
            return None
        branch = Hypothesis(
            (given.hypothesis.first, alone.fit),
            given.hypothesis.trials,
            effects=(answer_of([alone], [1.0], kinds),),
            localized=given.hypothesis.localized,
            fitted=tuple(sorted(given.fitted, key=lambda one: -one.score)),
            tried=given.tried,
        )
        terms = Criteria(stated=self.stated, pulled=False, asked=self.asked)
        step = accept(branch, alone.fit, [both], given.trials, kinds, terms)
        if not step.added:
            holds = step.hypothesis.suggested_holds
            if holds is None:
                return None
            return SearchStep(
                dataclasses.replace(given.hypothesis, suggested_holds=holds), added=0
            )
        pairs = [(label_of(first.effect), label_of(second.effect)) for first, second in good]
        shared = _with_shares(step.hypothesis, kinds, pairs, [second for _, second in good])
        return SearchStep(shared, added=2)


def without_imitations(
    good: Sequence[tuple[Candidate, FittedCandidate]], kinds: Mapping[str, Kind]
) -> list[tuple[Candidate, FittedCandidate]]:
    """Leave out pairs that do by more numbers what another pair does at the same places."""

    # A jump of stiffness before the records begin is a spring.
    def effects(pair: tuple[Candidate, FittedCandidate]) -> tuple[Effect, Effect]:
        return pair[0].effect, pair[1].effect

    def numbers(pair: tuple[Candidate, FittedCandidate]) -> int:
        return sum(p.fitted for one in effects(pair) for p in kinds[one.kind].parameters)

    def imitates(
        pair: tuple[Candidate, FittedCandidate], other: tuple[Candidate, FittedCandidate]
    ) -> bool:
        here, there = ({one.place for one in effects(both)} for both in (pair, other))
        gained = other[1].fit.cost - pair[1].fit.cost
        few = here == there and numbers(other) < numbers(pair)
        return few and gained < 2 * LIMITS.least_log_evidence

    return [one for one in good if not any(imitates(one, other) for other in good)]


def label_of_pair(pair: LawPair) -> PairLabel:
    """Give two effects without their numbers, in any order."""
    return frozenset(label_of(one.effect) for one in pair)


def _not_done(pairs: Iterable[LawPair], done: Collection[PairLabel]) -> Iterator[LawPair]:
    """Give each pair once, but those that were fitted already."""
    known = set(done)
    for pair in pairs:
        label = label_of_pair(pair)
        if label not in known:
            known.add(label)
            yield pair


def _fit_pair(
    given: Round,
    one: Candidate,
    other: Candidate,
    good: Sequence[tuple[Candidate, FittedCandidate]],
    near: float,
) -> FittedCandidate | None:
    """Fit two laws; on from where the fit was given up, if that was near."""
    known = carry_effect(given.before, one.effect, given.kinds)
    noise = good[0][1].fit.noise if good else None
    enough = LIMITS.explained_chi2 * given.before.data
    both = fit_candidate(
        known, other.effect, given.trials, given.kinds, noise,
        control=FitControl(cost_to_beat=enough, is_late=lambda: given.monitor.is_late),
        schedule=FitSchedule(start=other.start),
    )  # fmt: skip
    if both is None or not LIMITS.explained_chi2 < both.fit.chi2_in_band < near:
        return both
    return _fitted_on(both, given.trials, given.kinds)


def _fitted_on(
    both: FittedCandidate, trials: Sequence[Trial], kinds: Mapping[str, Kind]
) -> FittedCandidate:
    """Fit a pair on from where it was given up, and from a better instant of its switch."""
    fit = try_refit(
        both.fit.plant, trials, values=both.fit.values, states=both.fit.states, horizons=(1.0,)
    )
    if fit is None:
        return both
    # A pair that is right ends a moment beside the true instant.
    fit = refine_switching_instant(fit, trials, kinds, None, math.inf)
    return dataclasses.replace(both, fit=fit, score=evidence(fit, kinds))


def _pairs_of_fitted(
    fitted: Sequence[FittedCandidate], bare: Fit, kinds: Mapping[str, Kind]
) -> Iterator[LawPair]:
    """Give laws two by two that each explain something alone, the best first."""
    bar = MAX_SINGLE_REST * bare.chi2_in_band
    some = [one for one in fitted if one.fit.chi2_in_band < bar][:PAIRED_LAWS]
    effects = [fitted_effect(one) for one in some]
    numbers = itertools.combinations(range(len(effects)), 2)
    for i, j in sorted(numbers, key=sum):
        one, other = effects[i], effects[j]
        own = variable_of(one, kinds)
        # Two pieces of one curve each explain something of any curve, so that is no evidence.
        pieces = own is not None and own == variable_of(other, kinds)
        if one.place == other.place and (pieces or one.kind == other.kind):
            continue
        yield Candidate(one, 0.0, 0.0, 0.0), Candidate(other, 0.0, 0.0, 0.0)


def _with_shares(
    hypothesis: Hypothesis,
    kinds: Mapping[str, Kind],
    pairs: Sequence[tuple[Label, Label]],
    fitted: Sequence[FittedCandidate],
) -> Hypothesis:
    """Give each of two laws the probability of all pairs that it is one of."""
    shares = shares_of(fitted, kinds)
    effects = []
    for named in hypothesis.effects:
        label = label_of(named.effect)
        rivals = tuple(
            Rival(*other, share)
            for pair, share in zip(pairs, shares, strict=True)
            for other in pair
            if label not in pair and other not in pairs[0] and share > LIMITS.told_probability
        )
        sure = sum(s for pair, s in zip(pairs, shares, strict=True) if label in pair)
        effects.append(dataclasses.replace(named, probability=sure, rivals=rivals))
        if sure < LIMITS.decided_probability and not hypothesis.undecided:
            hypothesis = dataclasses.replace(
                hypothesis, undecided=(Rival(*label, sure), *rivals), pair=tuple(fitted[:2])
            )
    return dataclasses.replace(hypothesis, effects=tuple(effects))

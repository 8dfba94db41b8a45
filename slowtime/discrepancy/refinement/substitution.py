"""Repeated search for each of several effects beside the others (backward substitution).

What was named first was named while the others were missing: it may be a neighbour of the right
one, or stand for half of it and half of another. Beside the others it is the only one missing,
and is looked for as one is.
"""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

from slowtime.discrepancy.calibration import attempt
from slowtime.discrepancy.calibration.augmentation import fitted_effects, refit_without
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.candidates.library_fit import (
    Label,
    label_of,
    laws_left_by,
)
from slowtime.discrepancy.estimation.candidate_fit import best_of_each_place, fit_candidates
from slowtime.discrepancy.estimation.input_hold import Hold
from slowtime.discrepancy.estimation.model_evidence import fitted_effect
from slowtime.discrepancy.estimation.significance import sds_of_strength
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import moved_of
from slowtime.discrepancy.selection.acceptance import Criteria, accept, is_second_curve
from slowtime.discrepancy.selection.comparison import better, explains_all
from slowtime.discrepancy.selection.probabilities import first_doubts
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, Kind, general_kinds

from .elimination import eliminate, left_out

MIN_FEWER_LOG_EVIDENCE = -2.0
"""[nats] That fewer effects have to bring against more. Source: docs/what_decides.md: half and
double change no answer."""
WEAK_SDS = 10.0
"""[standard deviations] From nothing, below which a law of several parameters may be a
degenerate one. Source: docs/decisions/0030; laws that are not differ by fifty and more."""
NEW_CANDIDATES = 3
"""[candidates] Found beside the other effects that are tried in place of one. Source: a bound
on computing time."""
FITTED_CANDIDATES = 2
"""[candidates] Refitted when the first effect was found that are tried again. Source: a bound
on computing time."""


def substitute(
    hypothesis: Hypothesis,
    kinds: Mapping[str, Kind],
    stated: tuple[Hold, ...] | None,
    tell: Monitor,
) -> Hypothesis:
    """Put others in the place of effects, where that explains more; until nothing does."""
    if not is_worthwhile(hypothesis, kinds):
        return hypothesis
    weak = _weak_effects(hypothesis, kinds)
    for number in _in_turn(hypothesis, weak):
        # What does nothing of its own should not be told, late as it may be.
        needless = number in weak
        if tell.is_over or (tell.is_late and not needless):
            return dataclasses.replace(hypothesis, exhausted=True)
        branch = _searched_again(hypothesis, number, kinds, stated, tell)
        if branch is None:
            continue
        branch = branch.with_effects(
            *eliminate(branch.fits, branch.effects, branch.trials, kinds)
        )
        fewer = len(branch.effects) < len(hypothesis.effects)
        other = _labels(branch) != _labels(hypothesis)
        gentle = fewer or (needless and other)
        least = MIN_FEWER_LOG_EVIDENCE if gentle else LIMITS.least_log_evidence
        if better(hypothesis, branch, kinds, least) is not hypothesis:
            return substitute(branch, kinds, stated, tell)
    return hypothesis


def generalize(
    hypothesis: Hypothesis,
    kinds: Mapping[str, Kind],
    stated: tuple[Hold, ...] | None,
    tell: Monitor,
) -> Hypothesis:
    """Put more general laws in the place of those found, where that explains more."""
    whole = len(hypothesis.fits) == 1 + len(hypothesis.effects) and hypothesis.holds is None
    settled = hypothesis.final or hypothesis.without_sensor or explains_all(hypothesis)
    if settled or not whole or not hypothesis.fits_whole_records:
        return hypothesis
    for number, named in enumerate(hypothesis.effects):
        among = [k for k in general_kinds(kinds) if named.effect.kind in k.simpler]
        if not among:
            continue
        if tell.is_late:
            return dataclasses.replace(hypothesis, exhausted=True)
        branch = _searched_again(hypothesis, number, kinds, stated, tell, among)
        if branch is not None and better(hypothesis, branch, kinds) is not hypothesis:
            return branch if explains_all(branch) else generalize(branch, kinds, stated, tell)
    return hypothesis


def is_worthwhile(hypothesis: Hypothesis, kinds: Mapping[str, Kind]) -> bool:
    """Return whether several effects leave something, bend constants, are many, or are weak."""
    effects, last = hypothesis.effects, hypothesis.last
    whole = len(hypothesis.fits) == 1 + len(effects) and hypothesis.holds is None
    settled = hypothesis.final or hypothesis.without_sensor
    if len(effects) < 2 or settled or not whole or not hypothesis.fits_whole_records:
        return False
    much = (
        chi2_p_value(last) < LIMITS.coloured_p_value or bool(moved_of(last)) or len(effects) > 2
    )
    return much or bool(_weak_effects(hypothesis, kinds))


def _weak_effects(hypothesis: Hypothesis, kinds: Mapping[str, Kind]) -> list[int]:
    """Give numbers of laws of several parameters that may do what another law does."""
    # One whose strength is hardly more than its error is at the end of its range: what rides on
    # a node and swings without damping is a tone. One of general form imitates what was missing
    # with it when it was named.
    last, general = hypothesis.last, {kind.name for kind in general_kinds(kinds)}
    own = len(last.plant.effects) - len(hypothesis.effects)
    return [
        number
        for number, named in enumerate(hypothesis.effects)
        if named.effect.kind in general
        or (
            len(named.effect.parameters) > 1
            and sds_of_strength(last, own + number, kinds[named.effect.kind]) < WEAK_SDS
        )
    ]


def _labels(hypothesis: Hypothesis) -> set[Label]:
    return {label_of(one.effect) for one in hypothesis.effects}


def _in_turn(hypothesis: Hypothesis, weak: Sequence[int]) -> Iterator[int]:
    """Give numbers of effects: those first that do nothing, or where something is left."""
    rest = hypothesis.rest
    here = rest.groups[0].places if rest is not None else ()
    effects = hypothesis.effects
    yield from sorted(
        range(len(effects)), key=lambda i: (i not in weak, effects[i].effect.place not in here)
    )


def _searched_again(
    hypothesis: Hypothesis,
    number: int,
    kinds: Mapping[str, Kind],
    stated: tuple[Hold, ...] | None,
    tell: Monitor,
    among: Sequence[Kind] | None = None,
) -> Hypothesis | None:
    """Look for one effect again beside the others; the hypothesis with what was found."""
    last, trials = hypothesis.last, hypothesis.trials
    own = hypothesis.given_effects
    known = fitted_effects(last)[own + number]
    tell(f"looking again at {known.kind} at {known.place}", 0.86)
    less = refit_without(last, own + number, trials, kinds)
    if less is None:
        return None
    others = [a for i, a in enumerate(hypothesis.effects) if i != number]
    told = attempt(laws_left_by, less, trials, kinds, among)
    if told is None:
        return None
    before, located, tried = told
    branch = dataclasses.replace(
        hypothesis,
        fits=(hypothesis.first, *left_out(hypothesis.fits, number, less, trials, kinds)),
        effects=tuple(others),
        undecided=first_doubts(others),
        pair=None,
        constants_suffice=False,
        rest=located,
    )
    tried = [one for one in tried if not is_second_curve(one.effect, others, kinds)]
    if among is not None:
        tried = [one for one in tried if one.effect.place == known.place]
    beside = best_of_each_place(tried, NEW_CANDIDATES)
    if not beside:
        return None
    # What was fitted counts for as good as the best, until it is so again.
    again = [dataclasses.replace(beside[0], effect=e, start=None) for e in _fitted(hypothesis)]
    own_label = dataclasses.replace(beside[0], effect=known, start=None)
    candidates = {label_of(one.effect): one for one in reversed([own_label, *beside, *again])}

    def tick(effect: Effect, _: int) -> bool:
        tell(f"refitting {effect.kind} at {effect.place}", 0.86)
        return tell.is_over

    fitted = fit_candidates(before, list(reversed(candidates.values())), trials, kinds, tick)
    step = accept(
        branch,
        before,
        fitted,
        trials,
        kinds,
        Criteria(stated=stated, pulled=bool(moved_of(less))),
    )
    found = step.hypothesis
    if not step.added or found.holds is not None:
        return None
    return dataclasses.replace(found, rest=locate(found.last, trials))


def _fitted(hypothesis: Hypothesis) -> list[Effect]:
    """Give those that were fitted when the first was named, the best first."""
    named = {label_of(one.effect) for one in hypothesis.effects}
    rest = [one for one in hypothesis.fitted if label_of(one.effect) not in named]
    return [fitted_effect(one) for one in rest[:FITTED_CANDIDATES]]

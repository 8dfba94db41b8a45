"""Candidates judged by segments of the records, where whole records tell nothing.

The free run of a model that lacks much loses the phase of the records. What explains how they
begin, or their segments, is then fitted to these first.
"""

import dataclasses
from collections.abc import Sequence

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.candidates.library_fit import Candidate, label_of
from slowtime.discrepancy.estimation.candidate_fit import (
    best_of_each_place,
    fit_candidates,
    limit_of,
)
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate
from slowtime.discrepancy.estimation.shooting_fit import (
    first_of_each,
    merge_fits,
    shooting_fits,
)
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.proposers import Round
from slowtime.discrepancy.proposers.later_segments import later_segment_candidates
from slowtime.discrepancy.proposers.lower_ranked import InitialSegments
from slowtime.discrepancy.proposers.segments import Segments
from slowtime.discrepancy.selection.acceptance import is_second_curve
from slowtime.discrepancy.selection.shortlist import LATER_CANDIDATES, begins
from slowtime.discrepancy.selection.trial_order import TrialOrder
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect

from .settings import SearchSettings

UNTRACKED_CHI2 = 30.0
"""[noise variances] Mean square in band from which what a model with effects leaves of whole
records tells less than what it leaves of how they begin, or of their segments. Source:
docs/what_decides.md: half and double change no answer."""


def is_lost(fit: Fit) -> bool:
    """Whether what a fit leaves of whole records tells next to nothing."""
    return fit.chi2_in_band > UNTRACKED_CHI2


def shoot(
    given: Round,
    fitted: Sequence[FittedCandidate],
    begun: Sequence[FittedCandidate],
    how: SearchSettings,
    turn: TrialOrder,
) -> Sequence[FittedCandidate]:
    """Fit candidates to segments first where their free run went astray; all, the best first.

    Candidates `begun` were fitted to how records go on already.
    """
    if how.asks_all(given.number):
        likely = worth_shooting(given, fitted)
        return shooting_fits(given.before, likely, fitted, given.trials, given.kinds, turn)

    def is_late() -> bool:
        return how.monitor.is_late

    if how.options.quick or is_late():
        return fitted
    if not begun and fitted and fitted[0].fit.chi2_in_band > LIMITS.far_off_chi2:
        begun = fit_later_segments(given.hypothesis, given.before, how)
    fitted = merge_fits(fitted, begun, given.hypothesis.trials, given.kinds)
    if is_late():
        return fitted
    likely = first_of_each((), given.shortlist)
    return shooting_fits(given.before, likely, fitted, given.trials, given.kinds, turn)


def worth_shooting(given: Round, fitted: Sequence[FittedCandidate]) -> Sequence[Candidate]:
    """Give candidates that are fitted to segments first, should their free run go astray."""
    segments, initial = given.of(Segments().name), given.of(InitialSegments().name)
    if segments is not None and segments.candidates:
        # A law that is right, and loses its way in a whole record, is fitted to all segments.
        lost = bool(fitted) and fitted[0].fit.chi2_in_band > UNTRACKED_CHI2
        return segments.shot if lost else ()
    opened = initial.shot if initial is not None else ()
    begins_with = initial.begins if initial is not None else None
    alone = [one for one in opened if label_of(one.effect) == begins_with]
    return alone or first_of_each(opened, given.first_batch)


def those_of_beginnings(
    given: Round, fitted: Sequence[FittedCandidate]
) -> Sequence[FittedCandidate]:
    """Keep what explains how records begin, where the best leaves much of the whole."""
    if not fitted or fitted[0].fit.chi2_in_band <= LIMITS.far_off_chi2:
        return fitted
    # It is one of two effects, though more may be left by it. The simpler law that it becomes
    # stays beside it.
    segments, initial = given.of(Segments().name), given.of(InitialSegments().name)
    of_segments = segments.begins if segments is not None else None
    of_beginnings = initial.begins if initial is not None else None
    last = given.hypothesis.last
    kept = [one for one in fitted if label_of(one.effect) == of_segments] or [
        one for one in fitted if begins(one, of_beginnings, last)
    ]
    limits = [
        one
        for one in fitted
        if any(label_of(one.effect) == limit_of(other.effect) for other in kept)
    ]
    return [*kept, *limits] or fitted


def fit_later_segments(
    hypothesis: Hypothesis, before: Fit, how: SearchSettings
) -> list[FittedCandidate]:
    """Fit what may be missing as records go on, where the whole of them tells nothing."""
    monitor, kinds = how.monitor, how.kinds

    def tick(effect: Effect, _: int) -> bool:
        monitor(f"refitting {effect.kind} at {effect.place}", 0.5)
        return monitor.is_late

    monitor("looking at how records go on", 0.5)
    part, tried = later_segment_candidates(
        before, hypothesis.trials, kinds, lambda: monitor.is_late
    )
    tried = [one for one in tried if not is_second_curve(one.effect, hypothesis.effects, kinds)]
    more = before.data / max(part.data, 1)
    candidates = [
        dataclasses.replace(one, cost=more * one.cost, cost_without=more * one.cost_without)
        for one in best_of_each_place(tried, LATER_CANDIDATES)
    ]
    return fit_candidates(
        part, candidates, hypothesis.trials, kinds, tick, over=lambda: monitor.is_over
    )

"""One step of forward selection: localize what is missing, propose, fit, accept."""

import dataclasses
from collections.abc import Sequence

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.candidates.library_fit import (
    Candidate,
    Label,
    label_of,
    library_candidates,
)
from slowtime.discrepancy.data.clock_overrun import mask_clock_overrun
from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.discrepancy.estimation.candidate_fit import (
    Fitting,
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
from slowtime.discrepancy.hypothesis import Hypothesis, Step
from slowtime.discrepancy.localization import Localization, locate
from slowtime.discrepancy.proposers import LATER_PROPOSERS, Round
from slowtime.discrepancy.proposers.base_motion import base_motion, by_a_law, placed
from slowtime.discrepancy.proposers.delayed_input import pairs_with_delayed_input
from slowtime.discrepancy.proposers.joint_pairs import JointPairs, PairLabel, label_of_pair
from slowtime.discrepancy.proposers.later_segments import later_segment_candidates
from slowtime.discrepancy.proposers.lower_ranked import InitialSegments
from slowtime.discrepancy.proposers.segments import Segments
from slowtime.discrepancy.proposers.sensor_bias import (
    biased_accelerometer,
    sensor_bias_candidate,
)
from slowtime.discrepancy.proposers.sensor_drift import drifting, sensor_drift
from slowtime.discrepancy.quoting import moved_of
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refinement.constant_release import release_constants
from slowtime.discrepancy.selection.acceptance import (
    Terms,
    accept,
    end_with,
    is_second_curve,
)
from slowtime.discrepancy.selection.shortlist import (
    LATER_CANDIDATES,
    begins,
    begun_with,
    shortlist,
)
from slowtime.discrepancy.selection.trial_order import (
    TrialOrder,
    is_enough,
    near_first,
    simple_first,
)
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, Place

from .settings import SearchSettings

UNTRACKED_CHI2 = 30.0
"""[noise variances] Mean square in band from which what a model with effects leaves of whole
records tells less than what it leaves of how they begin, or of their segments. Source: chosen
on hidden cases."""


def extend(
    hypothesis: Hypothesis,
    before: Fit,
    how: SearchSettings,
    number: int,
    *,
    pulled: bool,
    begun: Sequence[FittedCandidate] = (),
    localized: Localization | None = None,
) -> Step:
    """Look for one effect more than a hypothesis has.

    Parameters
    ----------
    before
        Its last fit, with constants held to their tolerances or not: effects are added to it.
    number
        Effects that were looked for before.
    pulled
        Whether constants have left their tolerances.
    begun
        Candidates that were fitted already, by how records go on.
    localized
        Where a force is missing from `before`, if that is known.
    """
    monitor, share = how.monitor, 0.1 + 0.27 * number
    monitor("locating what is left", share)
    localized = localized or locate(before, hypothesis.trials)
    hypothesis = dataclasses.replace(
        hypothesis, localized=hypothesis.localized or localized, rest=localized
    )
    if localized.p_value > LIMITS.false_alarm_p_value and not pulled:
        return Step(hypothesis, added=0)
    much = not hypothesis.effects and hypothesis.last.chi2_in_band > LIMITS.far_off_chi2
    if much and not how.options.quick:
        sensor = biased_accelerometer(hypothesis.last, hypothesis.trials)
        if sensor is not None:
            return _name_sensor_error(hypothesis, before, localized, sensor, how)
    monitor("trying effects", share + 0.05)
    tried = library_candidates(before, localized, how.kinds)
    based = localized.with_base_first()
    moved_base = base_motion(based, tried, how.kinds, first=number == 0)
    if moved_base is not None and placed(based, tried):
        return end_with(hypothesis, before, moved_base, how.kinds)
    given = dataclasses.replace(
        _round(hypothesis, before, localized, tried, how, number),
        base_moves=moved_base is not None, share=share,
    )  # fmt: skip
    if number or how.options.quick:
        return _from_shortlist(given, how, moved_base, begun, pulled=pulled)
    return _from_proposals(given, how, moved_base, pulled=pulled)


def _name_sensor_error(
    hypothesis: Hypothesis,
    before: Fit,
    localized: Localization,
    sensor: Place,
    how: SearchSettings,
) -> Step:
    """Name what an accelerometer is steadily off by, before all else."""
    named = sensor_bias_candidate(before, sensor, localized, hypothesis.trials, how.kinds)
    if named is None:
        drift = drifting(before, hypothesis.trials, sensor, how.kinds)
        return Step(hypothesis, added=0, drift=drift)
    hypothesis = dataclasses.replace(hypothesis, fitted=(named,))
    terms = Terms(stated=how.stated, pulled=False, certain=True)
    return accept(hypothesis, before, [named], hypothesis.trials, how.kinds, terms)


def _round(
    hypothesis: Hypothesis,
    before: Fit,
    localized: Localization,
    tried: Sequence[Candidate],
    how: SearchSettings,
    number: int,
) -> Round:
    """Put together what proposers are asked with."""
    effects, kinds = hypothesis.effects, how.kinds
    tried = [one for one in tried if not is_second_curve(one.effect, effects, kinds)]
    short = shortlist(
        hypothesis, before, localized, tried, kinds, number=number, quick=how.options.quick
    )
    channels = tuple(s.channel for s in before.plant.description.sensors)
    trials = mask_clock_overrun(
        hypothesis.trials, channels, (one.effect for one in short), kinds
    )
    return Round(
        hypothesis=hypothesis, before=before, localized=localized, tried=tuple(tried),
        shortlist=tuple(short), trials=trials, kinds=kinds, monitor=how.monitor, number=number,
    )  # fmt: skip


def _from_shortlist(
    given: Round,
    how: SearchSettings,
    moved_base: NamedEffect | None,
    begun: Sequence[FittedCandidate],
    *,
    pulled: bool,
) -> Step:
    """Fit the shortlist of a later effect, or of a quick search, and accept the best."""
    number, monitor, kinds = given.number, given.monitor, given.kinds
    far: set[Label] = set()
    if number:
        in_turn, far = near_first(list(given.shortlist), kinds)
    else:
        in_turn = simple_first(given.shortlist, kinds)
    turn = TrialOrder(monitor, number, len(in_turn), given.share, far)
    fitting = _fitting(given, turn).fit(in_turn)
    given = dataclasses.replace(given, fitted=fitting.found)
    if number and not how.options.quick:
        given, fitting = _fit_later_proposals(given, fitting)
    fitted = fitting.ranked(lambda: monitor.is_over)
    turn.must &= not fitted
    if not number:
        released = _with_released_constants(given, fitted, how)
        if released is not None:
            return released
    stopped = _stopped(given, fitted, turn)
    if stopped is not None:
        return stopped
    otherwise = _explained_otherwise(given, fitted, moved_base)
    if otherwise is not None:
        return otherwise
    if number and not (how.options.quick or monitor.is_late):
        before = given.before
        if not begun and fitted and fitted[0].fit.chi2_in_band > LIMITS.far_off_chi2:
            begun = fit_later_segments(given.hypothesis, before, how)
        fitted = merge_fits(fitted, begun, given.hypothesis.trials, kinds)
        if not monitor.is_late:
            likely = first_of_each((), given.shortlist)
            fitted = shooting_fits(before, likely, fitted, given.trials, kinds, turn)
    hypothesis = given.hypothesis
    if not number:
        hypothesis = dataclasses.replace(
            hypothesis, fitted=tuple(fitted), tried=given.tried, nested=fitting.nested
        )
    return accept_best(hypothesis, given.before, fitted, how, given.trials, pulled=pulled)


def _fit_later_proposals(given: Round, fitting: Fitting) -> tuple[Round, Fitting]:
    """Fit what is proposed for a later effect where the shortlist does not explain it."""
    for proposer in LATER_PROPOSERS:
        if fitting.stopped:
            break
        proposal = proposer(given)
        fitting = fitting.fit(proposal.candidates)
        given = dataclasses.replace(
            given, fitted=fitting.found, proposals=(*given.proposals, proposal)
        )
    return given, fitting


def _from_proposals(
    given: Round, how: SearchSettings, moved_base: NamedEffect | None, *, pulled: bool
) -> Step:
    """Fit what the proposers propose for the first effect, and accept the best."""
    joint = JointPairs(how.stated, how.asked)
    late = list(pairs_with_delayed_input(given))
    step = joint(given, late, given.before.chi2_in_band) if late else None
    if step is not None:
        return _with_tried(step, given)
    given, step, turn, fitting = _fit_proposals(
        given, how, joint, frozenset(map(label_of_pair, late))
    )
    if step is not None:
        return _with_tried(step, given)
    fitted = fitting.ranked(lambda: how.monitor.is_over)
    turn.must &= not fitted
    released = _with_released_constants(given, fitted, how)
    if released is not None:
        return released
    stopped = _stopped(given, fitted, turn) or _explained_otherwise(given, fitted, moved_base)
    if stopped is not None:
        return _with_tried(stopped, given)
    fitted = shooting_fits(
        given.before, worth_shooting(given, fitted), fitted, given.trials, given.kinds, turn
    )
    hypothesis = dataclasses.replace(
        given.hypothesis, fitted=tuple(fitted), tried=given.tried, nested=fitting.nested
    )
    first = those_of_beginnings(given, fitted)
    return accept_best(hypothesis, given.before, first, how, given.trials, pulled=pulled)


def _with_tried(step: Step, given: Round) -> Step:
    """Keep the candidates of the first effect with the hypothesis."""
    if step.hypothesis.tried:
        return step
    hypothesis = dataclasses.replace(
        step.hypothesis,
        tried=given.tried,
        fitted=tuple(sorted(given.fitted, key=lambda one: -one.score)),
    )
    return dataclasses.replace(step, hypothesis=hypothesis)


def _fit_proposals(
    given: Round, how: SearchSettings, joint: JointPairs, done: frozenset[PairLabel]
) -> tuple[Round, Step | None, TrialOrder, Fitting]:
    """Ask proposer after proposer and fit what they give, until nothing is missing any more.

    Returns
    -------
    The round with all fits; the step of two joint effects, if they explain what one does not;
    the order of trials, which knows what there was no budget for; and the fits.
    """
    turn, fitting = None, None
    for proposer in how.options.proposers:
        proposal = proposer(given)
        given = dataclasses.replace(given, proposals=(*given.proposals, proposal))
        if not proposal.candidates:
            continue
        batch = list(proposal.candidates)
        if turn is None or fitting is None:
            batch = simple_first(batch, given.kinds)
            turn = TrialOrder(given.monitor, 0, len(batch), given.share, set())
            fitting = _fitting(given, turn)
        fitting = fitting.fit(batch)
        given = dataclasses.replace(given, fitted=fitting.found)
        if fitting.stopped:
            break
        pairs = joint.of_round(given, done)
        done |= frozenset(map(label_of_pair, pairs))
        fitted = sorted(given.fitted, key=lambda one: -one.score)
        best = fitted[0].fit if fitted else given.before
        step = joint(given, pairs, best.chi2_in_band) if pairs else None
        if step is not None:
            return given, step, turn, fitting
        if begun_with(fitted, given.before, given.localized):
            break
    if turn is None or fitting is None:
        turn = TrialOrder(given.monitor, 0, 0, given.share, set())
        fitting = _fitting(given, turn)
    return given, None, turn, fitting


def _fitting(given: Round, turn: TrialOrder) -> Fitting:
    return Fitting(
        before=given.before,
        trials=given.trials,
        kinds=given.kinds,
        tick=turn,
        late=turn.is_late,
    )


def _with_released_constants(
    given: Round, fitted: Sequence[FittedCandidate], how: SearchSettings
) -> Step | None:
    """Look again from constants that a law has led out of a local minimum."""
    hypothesis = given.hypothesis
    if hypothesis.released:
        return None
    loose = release_constants(hypothesis.last, fitted, hypothesis.trials)
    if loose is None:
        return None
    again = dataclasses.replace(
        hypothesis, fits=(*hypothesis.fits[:-1], loose), localized=None, released=True
    )
    held = refit_within_tolerances(loose, hypothesis.trials)
    return extend(again, held, how, given.number, pulled=bool(moved_of(loose)))


def _stopped(given: Round, fitted: Sequence[FittedCandidate], turn: TrialOrder) -> Step | None:
    """Stop where the budget ended before it was seen which candidate it is."""
    if not turn.cut:
        return None
    seen = given.number == 0 or (fitted and is_enough(fitted[0], turn.cut[0], given.kinds))
    if fitted and seen:
        return None
    return Step(dataclasses.replace(given.hypothesis, exhausted=True), added=0)


def _explained_otherwise(
    given: Round, fitted: Sequence[FittedCandidate], moved_base: NamedEffect | None
) -> Step | None:
    """Name a drifting sensor or a moving base, where no law leaves noise only."""
    if fitted and chi2_p_value(fitted[0].fit) >= LIMITS.coloured_p_value:
        return None
    before, kinds = given.before, given.kinds
    drift = sensor_drift(before, given.localized, kinds)
    if drift is not None:
        return Step(given.hypothesis, added=0, drift=drift)
    # What is as slow as that is a sensor's, though the base would do the same.
    based = given.localized.with_base_first()
    if moved_base is not None and not by_a_law(
        fitted, given.first_batch, before, given.trials, based
    ):
        return end_with(given.hypothesis, before, moved_base, kinds)
    return None


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
    """Keep what explains how records begin, where the best leaves much of the whole.

    It is one of two effects, though more may be left by it. The simpler law that it becomes
    stays beside it.
    """
    if not fitted or fitted[0].fit.chi2_in_band <= LIMITS.far_off_chi2:
        return fitted
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


def accept_best(
    hypothesis: Hypothesis,
    before: Fit,
    fitted: Sequence[FittedCandidate],
    how: SearchSettings,
    trials: tuple[Trial, ...] | None = None,
    *,
    pulled: bool,
) -> Step:
    """Accept the best candidate, then refine how records begin and where effects sit."""
    monitor, kinds = how.monitor, how.kinds
    terms = Terms(
        stated=how.stated, pulled=pulled, asked=how.asked,
        same_place=any(_sits_on(one.effect, hypothesis) for one in fitted[:1]),
        over=(lambda: monitor.is_over) if hypothesis.effects else bool,
    )  # fmt: skip
    step = accept(hypothesis, before, fitted, trials or hypothesis.trials, kinds, terms)
    if not step.added or monitor.is_over or step.hypothesis.final:
        return step
    found = step.hypothesis
    for refine in how.options.refiners:
        found = refine(found, kinds, monitor)
    return dataclasses.replace(step, hypothesis=found)


def _sits_on(effect: Effect, hypothesis: Hypothesis) -> bool:
    """Return whether a law is at a place that has one already."""
    there = any(one.effect.place == effect.place for one in hypothesis.effects)
    return there and effect.place.kind != "sensor"


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

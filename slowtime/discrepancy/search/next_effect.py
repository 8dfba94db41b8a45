"""The next effect: where a force is missing, what may act there, and whether it is accepted.

`next_effect` asks what the last hypothesis leaves, and `extend` answers:

    place -> candidates of each proposer -> fits -> the likeliest, accepted or not -> refined
"""

import dataclasses
from collections.abc import Sequence

from slowtime.discrepancy.calibration import BREAKDOWNS, Fit
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.candidates.library_fit import Candidate, Label, library_candidates
from slowtime.discrepancy.data.clock_overrun import mask_clock_overrun
from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.discrepancy.estimation.candidate_fit import Fitting
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate
from slowtime.discrepancy.hypothesis import Hypothesis, SearchStep
from slowtime.discrepancy.localization import Localization, locate
from slowtime.discrepancy.proposers import Proposal, Proposer, Round
from slowtime.discrepancy.proposers.base_motion import base_motion, by_a_law, placed
from slowtime.discrepancy.proposers.delayed_input import pairs_with_delayed_input
from slowtime.discrepancy.proposers.joint_pairs import (
    JointPairs,
    LawPair,
    PairLabel,
    label_of_pair,
)
from slowtime.discrepancy.proposers.measured_motion import pairs_along_measured_motion
from slowtime.discrepancy.proposers.sensor_bias import (
    biased_accelerometer,
    sensor_bias_candidate,
)
from slowtime.discrepancy.proposers.sensor_drift import drifting, sensor_drift
from slowtime.discrepancy.quoting import moved_of
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refinement.constant_release import release_constants
from slowtime.discrepancy.refinement.convergence import converge
from slowtime.discrepancy.refinement.force_relearning import relearn_force
from slowtime.discrepancy.selection.acceptance import (
    Criteria,
    accept,
    end_with,
    is_second_curve,
)
from slowtime.discrepancy.selection.comparison import leaves_too_little
from slowtime.discrepancy.selection.shortlist import begun_with, shortlist
from slowtime.discrepancy.selection.trial_order import (
    TrialOrder,
    is_enough,
    near_first,
    simple_first,
)
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, Place

from .lost_records import fit_later_segments, is_lost, shoot, those_of_beginnings
from .settings import SearchSettings

NOTHING_LEFT_P_VALUE = 0.01
"""[probability] p-value of chi squared above which nothing more is looked for after the first
effect. Source: the 1 % level."""


def next_effect(
    found: Hypothesis, how: SearchSettings, number: int, tolerated: Fit | None = None
) -> SearchStep:
    """Look for one effect more than a hypothesis has.

    `tolerated` is the last fit with its constants held to their tolerances, where known.
    """
    before = found.last
    pulled = bool(moved_of(before))
    if found.effects and chi2_p_value(before) > NOTHING_LEFT_P_VALUE:
        if pulled:
            # Of parameters told only together, one may have stopped far from its claim.
            found = converge(found, found.given_effects, how.kinds)
            before = found.last
            pulled = bool(moved_of(before))
        if not pulled:
            return SearchStep(found, added=0)
    if not pulled and leaves_too_little(found):
        return SearchStep(found, added=0)
    tolerated = tolerated or refit_within_tolerances(before, found.trials)
    localized = locate(tolerated, found.trials) if found.effects else None
    if localized is not None:
        relearnt = relearn_force(found, tolerated, localized, how.kinds, how.monitor)
        if relearnt is not found:
            return SearchStep(relearnt, added=0, again=True)
    lost = number > 0 and is_lost(tolerated) and not how.options.quick
    later_segments = fit_later_segments(found, tolerated, how) if lost else []
    if later_segments and later_segments[0].fit.chi2_in_band < LIMITS.far_off_chi2:
        rest = localized or locate(tolerated, found.trials)
        found = dataclasses.replace(found, rest=rest, localized=found.localized or rest)
        return accept_best(found, tolerated, later_segments, how, pulled=pulled)
    step = extend(
        found,
        tolerated,
        how,
        number,
        pulled=pulled,
        later_segments=later_segments,
        localized=localized,
    )
    found = step.hypothesis
    # Another effect that is still missing may be what bends constants, and needs them so.
    no_second_try = number == 0 or tolerated is before or found.final or found.holds is not None
    if step.added or step.again or step.drift or no_second_try or how.monitor.is_late:
        return step
    return extend(found, before, how, number, pulled=pulled)


def extend(
    hypothesis: Hypothesis,
    before: Fit,
    how: SearchSettings,
    number: int,
    *,
    pulled: bool,
    later_segments: Sequence[FittedCandidate] = (),
    localized: Localization | None = None,
) -> SearchStep:
    """Add the likeliest effect to a fit, where one is worth its parameters.

    Constants of `before` are held to their tolerances or not; `pulled` says whether they have
    left them. `later_segments` were fitted already, by how records go on; `localized` is where
    a force is missing from `before`, if that is known.
    """
    monitor, share = how.monitor, 0.1 + 0.27 * number
    monitor("locating what is left", share)
    localized = localized or locate(before, hypothesis.trials)
    hypothesis = dataclasses.replace(
        hypothesis, localized=hypothesis.localized or localized, rest=localized
    )
    if localized.p_value > LIMITS.false_alarm_p_value and not pulled:
        return SearchStep(hypothesis, added=0)
    much = not hypothesis.effects and hypothesis.last.chi2_in_band > LIMITS.far_off_chi2
    if much and not how.options.quick:
        sensor = biased_accelerometer(hypothesis.last, hypothesis.trials)
        if sensor is not None:
            return _name_sensor_error(hypothesis, before, localized, sensor, how)
    monitor("trying effects", share + 0.05)
    tried = library_candidates(before, localized, how.kinds)
    monitor.so_far = _so_far(hypothesis, tried, how)
    based = localized.with_base_first()
    moved_base = base_motion(based, tried, how.kinds, first=number == 0)
    if moved_base is not None and placed(based, tried):
        return end_with(hypothesis, before, moved_base, how.kinds)
    given = dataclasses.replace(
        _round(hypothesis, before, localized, tried, how, number),
        base_moves=moved_base is not None, share=share,
    )  # fmt: skip
    fits = _fit_proposals(given, how)
    step = _best_of(fits, how, moved_base, later_segments, pulled=pulled)
    return step if number or step.again else _with_tried(step, fits.given)


def accept_best(
    hypothesis: Hypothesis,
    before: Fit,
    fitted: Sequence[FittedCandidate],
    how: SearchSettings,
    trials: tuple[Trial, ...] | None = None,
    *,
    pulled: bool,
) -> SearchStep:
    """Accept the best candidate, then refine how records begin and where effects sit."""
    monitor, kinds = how.monitor, how.kinds
    terms = Criteria(
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


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Fits:
    """What was proposed and fitted in one round.

    Parameters
    ----------
    step
        Of two effects at once, where they explain what none does alone.
    """

    given: Round
    turn: TrialOrder
    fitting: Fitting
    step: SearchStep | None = None


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


def _fit_proposals(given: Round, how: SearchSettings) -> _Fits:
    """Ask proposer after proposer and fit what they give, until nothing is missing any more."""
    joint = JointPairs(how.stated, how.asked)
    asks_all = how.asks_all(given.number)
    done: frozenset[PairLabel] = frozenset()
    fits = _begin(given, ())
    if asks_all:
        pairs = [*pairs_with_delayed_input(given), *pairs_along_measured_motion(given)]
        fits, done = _fit_pairs(fits, joint, pairs, done)
    for proposer in how.proposers_of(given.number):
        if fits.step is not None or fits.fitting.stopped:
            break
        proposal = _ask(proposer, fits.given)
        given = dataclasses.replace(fits.given, proposals=(*fits.given.proposals, proposal))
        fits = dataclasses.replace(fits, given=given)
        batch: Sequence[Candidate] = proposal.candidates
        if not batch:
            continue
        if not fits.fitting.count:
            batch, far = _in_turn(given, batch)
            fits = _begin(given, batch, far)
        fitting = fits.fitting.fit(batch)
        given = dataclasses.replace(given, fitted=fitting.found)
        fits = dataclasses.replace(fits, given=given, fitting=fitting)
        if not asks_all or fitting.stopped:
            continue
        fits, done = _fit_pairs(fits, joint, joint.of_round(given, done), done)
        if begun_with(_ranked(given), given.before, given.localized):
            break
    return fits


def _ask(proposer: Proposer, given: Round) -> Proposal:
    """Ask a proposer; one whose numbers break down proposes nothing, which is noted."""
    try:
        return proposer(given)
    except BREAKDOWNS as error:
        given.monitor.note(
            f"Proposer {proposer.name!r} failed while effect {given.number + 1} was looked for "
            f"({error}); only what the others propose was fitted."
        )
        return Proposal(proposer.name, ())


def _begin(
    given: Round, batch: Sequence[Candidate], far: frozenset[Label] = frozenset()
) -> _Fits:
    """Begin with the first batch of candidates."""
    turn = TrialOrder(given.monitor, given.number, len(batch), given.share, far)
    return _Fits(
        given,
        turn,
        Fitting(
            before=given.before, trials=given.trials, kinds=given.kinds, tick=turn,
            late=turn.is_late,
        ),
    )  # fmt: skip


def _in_turn(
    given: Round, batch: Sequence[Candidate]
) -> tuple[Sequence[Candidate], frozenset[Label]]:
    """Give candidates in the order in which they are fitted, and which are far behind."""
    if given.number:
        ordered, far = near_first(list(batch), given.kinds)
        return ordered, frozenset(far)
    return simple_first(batch, given.kinds), frozenset()


def _fit_pairs(
    fits: _Fits, joint: JointPairs, pairs: Sequence[LawPair], done: frozenset[PairLabel]
) -> tuple[_Fits, frozenset[PairLabel]]:
    """Fit two effects at once, pair after pair; give those that were fitted, too."""
    if not pairs:
        return fits, done
    best = _ranked(fits.given)[0].fit if fits.given.fitted else fits.given.before
    step = joint(fits.given, pairs, best.chi2_in_band)
    done |= frozenset(map(label_of_pair, pairs))
    return dataclasses.replace(fits, step=step), done


def _ranked(given: Round) -> list[FittedCandidate]:
    return sorted(given.fitted, key=lambda one: -one.score)


def _best_of(
    fits: _Fits,
    how: SearchSettings,
    moved_base: NamedEffect | None,
    later_segments: Sequence[FittedCandidate],
    *,
    pulled: bool,
) -> SearchStep:
    """Accept the best of what was fitted, unless something else explains the records."""
    if fits.step is not None:
        return fits.step
    given, turn = fits.given, fits.turn
    fitted = fits.fitting.ranked(lambda: how.monitor.is_over)
    turn.must &= not fitted
    step = (
        _released(given, fitted)
        or _stopped(given, fitted, turn)
        or _explained_otherwise(given, fitted, moved_base)
    )
    if step is not None:
        return step
    fitted = list(shoot(given, fitted, later_segments, how, turn))
    hypothesis = given.hypothesis
    if not given.number:
        hypothesis = dataclasses.replace(
            hypothesis, fitted=tuple(fitted), tried=given.tried, nested=fits.fitting.nested
        )
    likely = those_of_beginnings(given, fitted)
    return accept_best(hypothesis, given.before, likely, how, given.trials, pulled=pulled)


def _with_tried(step: SearchStep, given: Round) -> SearchStep:
    """Keep the candidates of the first effect with the hypothesis."""
    if step.hypothesis.tried:
        return step
    hypothesis = dataclasses.replace(
        step.hypothesis, tried=given.tried, fitted=tuple(_ranked(given))
    )
    return dataclasses.replace(step, hypothesis=hypothesis)


def _name_sensor_error(
    hypothesis: Hypothesis,
    before: Fit,
    localized: Localization,
    sensor: Place,
    how: SearchSettings,
) -> SearchStep:
    """Name what an accelerometer is steadily off by, before all else."""
    named = sensor_bias_candidate(before, sensor, localized, hypothesis.trials, how.kinds)
    if named is None:
        drift = drifting(before, hypothesis.trials, sensor, how.kinds)
        return SearchStep(hypothesis, added=0, drift=drift, base=before)
    hypothesis = dataclasses.replace(hypothesis, fitted=(named,))
    terms = Criteria(stated=how.stated, pulled=False, certain=True)
    return accept(hypothesis, before, [named], hypothesis.trials, how.kinds, terms)


def _released(given: Round, fitted: Sequence[FittedCandidate]) -> SearchStep | None:
    """Look again from constants that a law has led out of a local minimum."""
    hypothesis = given.hypothesis
    if given.number or hypothesis.released:
        return None
    loose = release_constants(hypothesis.last, fitted, hypothesis.trials)
    if loose is None:
        return None
    again = dataclasses.replace(
        hypothesis, fits=(*hypothesis.fits[:-1], loose), localized=None, released=True
    )
    return SearchStep(again, added=0, again=True)


def _stopped(
    given: Round, fitted: Sequence[FittedCandidate], turn: TrialOrder
) -> SearchStep | None:
    """Stop where the budget ended before it was seen which candidate it is."""
    if not turn.cut:
        return None
    seen = given.number == 0 or (fitted and is_enough(fitted[0], turn.cut[0], given.kinds))
    if fitted and seen:
        return None
    return SearchStep(dataclasses.replace(given.hypothesis, exhausted=True), added=0)


def _explained_otherwise(
    given: Round, fitted: Sequence[FittedCandidate], moved_base: NamedEffect | None
) -> SearchStep | None:
    """Name a drifting sensor or a moving base, where no law leaves noise only."""
    if fitted and chi2_p_value(fitted[0].fit) >= LIMITS.coloured_p_value:
        return None
    before, kinds = given.before, given.kinds
    drift = sensor_drift(before, given.localized, kinds)
    if drift is not None:
        return SearchStep(given.hypothesis, added=0, drift=drift, base=before)
    # What is as slow as that is a sensor's, though the base would do the same.
    based = given.localized.with_base_first()
    if moved_base is not None and not by_a_law(
        fitted, given.first_batch, before, given.trials, based
    ):
        return end_with(given.hypothesis, before, moved_base, kinds)
    return None


def _so_far(hypothesis: Hypothesis, tried: Sequence[Candidate], how: SearchSettings) -> str:
    """Say what was found, and what most likely comes next."""
    told = [one.effect for one in hypothesis.effects] + [one.effect for one in tried[:1]]
    return ", ".join(f"{how.kinds[one.kind].words} at {one.place}" for one in told)


def _sits_on(effect: Effect, hypothesis: Hypothesis) -> bool:
    """Return whether a law is at a place that has one already."""
    there = any(one.effect.place == effect.place for one in hypothesis.effects)
    return there and effect.place.kind != "sensor"

"""A refitted model in; the effects that it lacks, found one by one, out.

Each effect is looked for in what the others leave. Where the first was named while another as
strong was missing, it may be the wrong one, or stand in the way: as long as much is left, one
begins again from the other end, with the second, or with the next that might have been first.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.quoting import moved_of
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, Kind, Place

from .calibration import Fit, FitAbandoned, FitControl, refit
from .calibration.tolerances import refit_within_tolerances
from .candidates.library_fit import Candidate, label_of, library_candidates
from .data.clock_overrun import mask_clock_overrun
from .diagnosis import NamedEffect
from .estimation.candidate_fit import FittedCandidate, best_of_each_place, fit_candidates
from .estimation.input_hold import Hold, held_otherwise, with_holds
from .estimation.shooting_fit import first_of_each, merge_fits, shooting_fits
from .localization import Localization, locate
from .progress import Monitor
from .proposers.alternative_starts import alternative_starts
from .proposers.base_motion import base_motion, by_a_law, placed
from .proposers.delayed_input import clocks_alone
from .proposers.joint_pairs import JointPairs
from .proposers.later_segments import later_segment_candidates
from .proposers.lower_ranked import LowerRanked
from .proposers.segments import SegmentCandidates
from .proposers.sensor_bias import biased_accelerometer, sensor_bias_candidate
from .proposers.sensor_drift import drifting, sensor_drift, with_sensor_again, without_sensor
from .records import Trial
from .refinement.constant_release import release_constants
from .refinement.convergence import converge
from .refinement.force_relearning import relearn_force
from .refinement.horizon_continuation import (
    refit_friction_with_growing_horizon,
    refit_with_growing_horizon,
)
from .refinement.initial_states import restart_initial_states
from .refinement.relocation import relocate
from .refinement.substitution import substitute
from .selection.acceptance import accept, end_with, is_second_curve
from .selection.comparison import better, explains_all
from .selection.shortlist import LATER, begins, begun_with, labels_of
from .selection.trial_order import TrialOrder, is_enough, near_first, simple_first
from .state import Found

SILENT = 0.01
"""Chance of so large a chi squared above which nothing more is looked for after the first."""
MOST = 3
"""Effects that are looked for, one after the other."""
LOST = 30.0
"""Mean square over the noise, in band, from which what a model with effects leaves of whole
records tells less than what it leaves of how they begin, or of their pieces."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Search:
    """What is looked for, and who is told.

    Parameters
    ----------
    quick
        One effect is looked for, among few.
    stated
        What the model says of its inputs between samples; as it stands where not given.
    asked
        Under which holds effects were looked for already.
    """

    kinds: Mapping[str, Kind]
    tell: Monitor
    quick: bool = False
    stated: tuple[Hold, ...] | None = None
    asked: tuple[tuple[Hold, ...] | None, ...] = ()

    @property
    def most(self) -> int:
        """How many effects are looked for."""
        return 1 if self.quick else MOST


def search(first: Fit, trials: tuple[Trial, ...], how: Search) -> Found:
    """Find what a model lacks, one effect after the other."""
    found = Found([first], trials)
    if how.quick:
        _go_on(found, how, 0)
        return found
    held = refit_within_tolerances(first, trials)
    one = _next(found, how, 0, held)
    if found.both is not None:
        found = found.both
        if not _ends(found, how, 1):
            _go_on(found, how, 2)
    elif one and not _explained_otherwise(found, how) and not _ends(found, how, 0):
        _go_on(found, how, 1)
    found = _begun_otherwise(found, held, trials, how)
    return found if found.otherwise is not None else _revised(found, how)


def _begun_otherwise(found: Found, held: Fit, trials: tuple[Trial, ...], how: Search) -> Found:
    """Begin with other effects, while much is left."""
    first = found.fits[0]
    cut = len(found.trials) != len(trials)
    again = found.holds is not None or found.otherwise is not None
    if not found.named or again or cut or explains_all(found):
        return found
    for other in alternative_starts(found, held, how.kinds, how.tell):
        if found.otherwise is not None or explains_all(found):
            break
        if how.tell.is_late:
            found.hurried = True
            break
        branch = Found([first], trials, located=found.located)
        bent = bool(moved_of(first))
        if accept(branch, held, [other], trials, how.kinds, how.stated, pulled=bent):
            _go_on(branch, how, 1)
            found = better(found, branch, how.kinds)
    return found


def _revised(found: Found, how: Search) -> Found:
    """Look for each of several effects again, and for what is missing then."""
    better = substitute(found, how.kinds, how.stated, how.tell)
    count = len(better.answers)
    if better is not found and count < how.most and not explains_all(better):
        _go_on(better, how, count)
    return better


def _go_on(found: Found, how: Search, begun: int) -> None:
    """Look for effects until there is none, or there are enough."""
    for number in range(begun, how.most):
        if (
            not _next(found, how, number)
            or _explained_otherwise(found, how)
            or _ends(found, how, number)
        ):
            return


def _explained_otherwise(found: Found, how: Search) -> bool:
    """Whether under another hold of the inputs what was found so far explains all.

    It is asked after each effect: a step that was taken for a curve looks like one more. Which
    effects there are has to be asked again, under that hold.
    """
    last = found.fits[-1]
    cut = any(len(fit.states) != len(found.trials) for fit in found.fits)
    over = found.ended or found.holds is not None or how.tell.is_late or cut
    if how.stated is None or over or not found.answers or explains_all(found):
        return False
    holds = held_otherwise(last, found.trials, how.kinds, how.stated)
    if holds is None or holds in how.asked:
        return False
    held = with_holds(last, holds, found.trials, how.kinds)
    if (
        held.chi2_in_band < LIMITS.explained_chi2
        or chi2_p_value(held) > LIMITS.coloured_p_value
    ):
        found.otherwise = holds
    return found.otherwise is not None


def reheld(found: Found, holds: tuple[Hold, ...], kinds: Mapping[str, Kind]) -> Found:
    """Give what was found its fits under another hold."""
    fits = [with_holds(fit, holds, found.trials, kinds) for fit in found.fits]
    left = locate(fits[-1], found.trials)
    return dataclasses.replace(found, fits=fits, holds=holds, left=left, hurried=True)


def _much(found: Found, how: Search) -> bool:
    """Whether nothing was found yet, and much is missing."""
    return (
        not (found.answers or how.quick) and found.fits[-1].chi2_in_band > LIMITS.far_off_chi2
    )


def _put_right(
    found: Found,
    before: Fit,
    located: Localization,
    place: Place,
    how: Search,
) -> bool:
    """Name what an accelerometer is steadily off by, before all else."""
    named = sensor_bias_candidate(before, place, located, found.trials, how.kinds)
    if named is None:
        return _wanders(found, before, drifting(before, found.trials, place, how.kinds), how, 0)
    found.named = (named,)
    return accept(
        found, before, [named], found.trials, how.kinds, how.stated, pulled=False, sure=True
    )


def _wanders(found: Found, before: Fit, drift: NamedEffect, how: Search, number: int) -> bool:
    """Name a drift that is on no law's course: a free run is better off without."""
    still = dict.fromkeys(drift.effect.parameters, 0.0)
    silent = dataclasses.replace(drift.effect, parameters=still)
    before = _by_the_others(found, before, drift, how, number)
    if found.answers and all(_mean(answer, drift) for answer in found.answers):
        found.answers, found.fits = [], found.fits[:1]
        before = refit_within_tolerances(found.fits[0], found.trials)
    return end_with(found, before, drift, how.kinds, silent)


def _mean(answer: NamedEffect, drift: NamedEffect) -> bool:
    """Whether a sensor was said to be off by the mean of its wandering."""
    own = answer.effect.place == drift.effect.place
    return own and answer.effect.kind == "sensor_bias"


def _by_the_others(
    found: Found, before: Fit, drift: NamedEffect, how: Search, number: int
) -> Fit:
    """Look for what is missing beside a sensor that wanders, by all that the others say.

    Gives the last fit: the one before, where there are no others, or nothing else is missing.
    """
    place = drift.effect.place
    trials = without_sensor(before, found.trials, place.id)
    # What the sensor was said to be off by was the mean of its wandering.
    kept = [answer for answer in found.answers if answer.effect.place != place]
    own = len(found.answers) - len(kept)
    whole = found.fits[0] if own else before
    number += 1 - own
    if (own and kept) or number >= how.most or not any(trial.used.any() for trial in trials):
        return before
    try:
        first = refit(
            whole.plant, trials, values=whole.values, states=whole.states,
            horizons=(1.0,), control=FitControl(is_late=lambda: how.tell.is_late),
        )  # fmt: skip
    except FitAbandoned:
        found.hurried = True
        return before
    except (np.linalg.LinAlgError, FloatingPointError):
        return before
    rest = Found([first], trials, answers=list(kept))
    _go_on(rest, how, number)
    found.hurried |= rest.hurried
    fresh = rest.answers[len(kept) :]
    cut = len(rest.trials) != len(trials)
    if not fresh or rest.ended or rest.holds is not None or cut:
        return before
    found.unheard = True
    found.located = found.located if kept else rest.located
    found.answers = [*kept, *fresh]
    found.fits = found.fits[: len(found.fits) - own]
    found.fits += [with_sensor_again(fit, before, place.id) for fit in rest.fits[1:]]
    if not found.undecided:
        found.undecided, found.pair, found.retuned = rest.undecided, rest.pair, rest.retuned
    return found.fits[-1]


def _ends(found: Found, how: Search, number: int) -> bool:
    """Whether what was found is to be enough; then, what it leaves."""
    found.hurried = how.tell.is_late
    enough = found.hurried and (how.tell.is_over or explains_all(found))
    if not enough and number < how.most - 1:
        return False
    # What the last effect leaves, not what there was before it.
    how.tell("looking at what is left", 0.9)
    found.left = locate(found.fits[-1], found.trials)
    return True


def _next(found: Found, how: Search, number: int, held: Fit | None = None) -> bool:
    """Look for one more effect; False where there is none.

    Parameters
    ----------
    held
        The last fit with its constants held to their tolerances, where that is known.
    """
    before = found.fits[-1]
    pulled = bool(moved_of(before))
    if found.answers and chi2_p_value(before) > SILENT:
        if pulled:
            # Of numbers that are told only together, one may have stopped far from its claim.
            converge(found, len(found.fits[0].plant.effects), how.kinds)
            before = found.fits[-1]
            pulled = bool(moved_of(before))
        if not pulled:
            return False
    held = held or refit_within_tolerances(before, found.trials)
    located = locate(held, found.trials) if found.answers else None
    if located is not None and relearn_force(found, held, located, how.kinds, how.tell):
        return _next(found, how, number)
    lost = number > 0 and held.chi2_in_band > LOST and not how.quick
    begun = _onward(found, held, how) if lost else []
    if begun and begun[0].fit.chi2_in_band < LIMITS.far_off_chi2:
        found.left = located or locate(held, found.trials)
        found.located = found.located or found.left
        return _accepted(found, held, begun, how, pulled=pulled)
    if _after(found, held, how, number, pulled=pulled, begun=begun, located=located):
        return True
    # Another effect that is still missing may be what bends them, and needs them so.
    over = number == 0 or held is before or found.ended or found.holds is not None
    return (
        not over and not how.tell.is_late and _after(found, before, how, number, pulled=pulled)
    )


def _after(
    found: Found,
    before: Fit,
    how: Search,
    number: int,
    *,
    pulled: bool,
    begun: Sequence[FittedCandidate] = (),
    located: Localization | None = None,
) -> bool:
    """Look for one more effect than a fit has.

    Parameters
    ----------
    begun
        What was refitted already, as how records begin tells.
    located
        What the fit leaves, where that is known.
    """
    kinds, tell = how.kinds, how.tell
    share = 0.1 + 0.27 * number
    tell("locating what is left", share)
    located = located or locate(before, found.trials)
    found.located, found.left = found.located or located, located
    if located.p_value > LIMITS.false_alarm_p_value and not pulled:
        return False
    stands = biased_accelerometer(found.fits[-1], found.trials) if _much(found, how) else None
    if stands is not None:
        return _put_right(found, before, located, stands, how)
    tell("trying effects", share + 0.05)
    tried = library_candidates(before, located, kinds)
    based = located.with_base_first()
    shaken = base_motion(based, tried, kinds, first=number == 0)
    if shaken is not None and placed(based, tried):
        return end_with(found, before, shaken, kinds)
    tried = [one for one in tried if not is_second_curve(one.effect, found.answers, kinds)]
    labels = labels_of(found, before, located, tried, how.kinds, number=number, quick=how.quick)
    channels = tuple(s.channel for s in before.plant.description.sensors)
    trials = mask_clock_overrun(found.trials, channels, (one.effect for one in labels), kinds)
    bent = found.fits[-1]
    first = not (number or how.quick)
    down = LowerRanked(
        bent, before, tried, labels, trials, kinds,
        best=located.groups[0].places, near=located.equivalent_places,
        several=located.groups[0].left > LIMITS.several_forces_chi2, shaken=shaken is not None,
        late=_late(tell, "fitting laws to how the records begin", share + 0.2),
    )  # fmt: skip
    pieces = SegmentCandidates(
        before, tried, labels, located, trials, kinds,
        _late(tell, "fitting laws to pieces of the records", share + 0.06),
    )  # fmt: skip
    together = JointPairs(before, trials, kinds, how.stated, how.asked, tell)

    def more(so_far: Sequence[FittedCandidate]) -> list[Candidate]:
        if not first or found.both is not None or found.otherwise is not None:
            return []
        found.named, found.tried = tuple(sorted(so_far, key=lambda n: -n.score)), tuple(tried)
        found.both = together(found)
        over = found.both is not None or found.otherwise is not None
        if over or begun_with(found.named, before, located):
            return []
        return pieces(so_far) or ([] if pieces.told else down(so_far))

    if first:
        found.tried = tuple(tried)
        found.both = together.beside_late(found)
        if found.both is not None or found.otherwise is not None:
            return found.both is not None
        clocks = clocks_alone(before, located, tried, trials, kinds)
        labels = clocks or pieces.at_once() or labels
    in_turn, far = near_first(labels, kinds) if number else (simple_first(labels, kinds), set())
    turn = TrialOrder(tell, number, len(in_turn), share, far)
    alike: list[FittedCandidate] = []
    named = fit_candidates(
        before, in_turn, trials, kinds, turn, more=more, alike=alike, over=lambda: tell.is_over
    )
    turn.must &= not named
    if found.both is not None or found.otherwise is not None:
        return found.both is not None
    loose = (
        release_constants(bent, named, found.trials)
        if number == 0 and not found.loosened
        else None
    )
    if loose is not None:
        found.fits[-1], found.located, found.loosened = loose, None, True
        held = refit_within_tolerances(loose, found.trials)
        return _after(found, held, how, number, pulled=bool(moved_of(loose)))
    if turn.cut and not (named and (number == 0 or is_enough(named[0], turn.cut[0], kinds))):
        found.hurried = True
        return False  # which of them it is was not seen
    if not named or chi2_p_value(named[0].fit) < LIMITS.coloured_p_value:
        drift = sensor_drift(before, located, kinds)
        if drift is not None:
            return _wanders(found, before, drift, how, number)
        # What is as slow as that is a sensor's, though the base would do the same.
        if shaken is not None and not by_a_law(named, labels, before, trials, based):
            return end_with(found, before, shaken, kinds)
    if number and not (how.quick or tell.is_late):
        if not begun and named and named[0].fit.chi2_in_band > LIMITS.far_off_chi2:
            begun = _onward(found, before, how)
        named = merge_fits(named, begun, found.trials, kinds)
    if not (how.quick or (number and tell.is_late)):
        alone = [one for one in down.opened if label_of(one.effect) == down.begins]
        likely = alone or first_of_each(down.opened, labels)
        if pieces.told:
            # A law that is right, and loses its way in a whole record, is fitted to all pieces.
            lost = bool(named) and named[0].fit.chi2_in_band > LOST
            likely = pieces.whole if lost else []
        named = shooting_fits(before, likely, named, trials, kinds, turn)
    if number == 0:
        found.named, found.tried, found.alike = tuple(named), tuple(tried), tuple(alike)
        if named and named[0].fit.chi2_in_band > LIMITS.far_off_chi2:
            # What explains how records begin is one of two, though more may be left by it.
            named = (
                [one for one in named if label_of(one.effect) == pieces.begins]
                or [one for one in named if begins(one, down.begins, bent)]
                or named
            )
    return _accepted(found, before, named, how, trials, pulled=pulled)


def _late(tell: Monitor, stage: str, share: float) -> Callable[[], bool]:
    def late() -> bool:
        tell(stage, share)
        return tell.is_late

    return late


def _accepted(
    found: Found,
    before: Fit,
    named: Sequence[FittedCandidate],
    how: Search,
    trials: tuple[Trial, ...] | None = None,
    *,
    pulled: bool,
) -> bool:
    """Take the best, begun where its records do; of several, from where all fit together."""
    fine = accept(
        found, before, named, trials or found.trials, how.kinds, how.stated, pulled=pulled,
        twice=any(_sits_on(one.effect, found.answers) for one in named[:1]), asked=how.asked,
        over=(lambda: how.tell.is_over) if found.answers else bool,
    )  # fmt: skip
    if not fine or how.tell.is_over or found.ended:
        return fine
    restart_initial_states(found, how.kinds)
    several = len(found.answers) > 1
    if not how.tell.is_late:
        (refit_with_growing_horizon if several else refit_friction_with_growing_horizon)(
            found, how.kinds
        )
    if several:
        relocate(found, how.kinds, how.tell)
    return True


def _sits_on(effect: Effect, answers: Sequence[NamedEffect]) -> bool:
    """Whether a law is at a place that has one already."""
    there = any(answer.effect.place == effect.place for answer in answers)
    return there and effect.place.kind != "sensor"


def _onward(found: Found, before: Fit, how: Search) -> list[FittedCandidate]:
    """Refit what may be missing as records go on, where the whole of them tells nothing."""

    def tick(effect: Effect, _: int) -> bool:
        how.tell(f"refitting {effect.kind} at {effect.place}", 0.5)
        return how.tell.is_late

    how.tell("looking at how records go on", 0.5)
    part, tried = later_segment_candidates(
        before, found.trials, how.kinds, lambda: how.tell.is_late
    )
    tried = [one for one in tried if not is_second_curve(one.effect, found.answers, how.kinds)]
    more = before.data / max(part.data, 1)
    labels = [
        dataclasses.replace(one, cost=more * one.cost, cost_without=more * one.cost_without)
        for one in best_of_each_place(tried, LATER)
    ]
    return fit_candidates(
        part, labels, found.trials, how.kinds, tick, over=lambda: how.tell.is_over
    )

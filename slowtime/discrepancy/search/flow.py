"""Forward selection of effects, begun again from other ends while much is left.

Each effect is looked for in what the others leave. Where the first was named while another as
strong was missing, it may be the wrong one, or stand in the way: as long as much is left, the
search begins again, with the second effect, or with the next that might have been first.
"""

import dataclasses

import numpy as np

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.combined_laws.search import explain_together, explains_most
from slowtime.discrepancy.estimation.input_hold import held_otherwise, with_holds
from slowtime.discrepancy.hypothesis import Hypothesis, Step
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.proposers.alternative_starts import alternative_starts
from slowtime.discrepancy.quoting import moved_of
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refinement.convergence import converge
from slowtime.discrepancy.refinement.force_relearning import relearn_force
from slowtime.discrepancy.refinement.substitution import generalize, substitute
from slowtime.discrepancy.selection.acceptance import Terms, accept
from slowtime.discrepancy.selection.comparison import (
    better,
    explains_all,
    leaves_too_little,
)
from slowtime.discrepancy.thresholds import LIMITS

from .drifting_sensor import end_with_drift
from .extension import UNTRACKED_CHI2, accept_best, extend, fit_later_segments
from .settings import SearchSettings

NOTHING_LEFT_P_VALUE = 0.01
"""[probability] p-value of chi squared above which nothing more is looked for after the first
effect. Source: the 1 % level."""


def search(first: Fit, trials: tuple[Trial, ...], how: SearchSettings) -> Hypothesis:
    """Find the effects that a model lacks.

    Parameters
    ----------
    first
        Fit of the model as given, its constants free within their tolerances.
    """
    together = explain_together(first, trials, how.kinds, how.monitor) if how.decays else None
    if together is not None and (not together.effects or explains_most(together)):
        return together
    found = Hypothesis((first,), trials)
    if how.options.quick:
        return continue_search(found, how, 0)
    held = refit_within_tolerances(first, trials)
    step = _next(found, how, 0, held)
    found = step.hypothesis
    if step.added:
        if step.added == 1:
            found = _suggest_holds(found, how)
        if found.suggested_holds is None:
            found, ends = _close(found, how, step.added - 1)
            found = found if ends else continue_search(found, how, step.added)
    found = _begin_otherwise(found, held, trials, how)
    if found.suggested_holds is not None:
        return found
    found = generalize(_revise(found, how), how.kinds, how.stated, how.monitor)
    return found if together is None else better(found, together, how.kinds)


def continue_search(found: Hypothesis, how: SearchSettings, begun: int) -> Hypothesis:
    """Look for effects beside those of a hypothesis, until there is none or there are enough.

    Parameters
    ----------
    begun
        Number of effects that were looked for before.
    """
    for number in range(begun, how.options.most):
        step = _next(found, how, number)
        found = step.hypothesis
        if not step.added:
            break
        found = _suggest_holds(found, how)
        if found.suggested_holds is not None:
            break
        found, ends = _close(found, how, number)
        if ends:
            break
    return found


def _next(found: Hypothesis, how: SearchSettings, number: int, held: Fit | None = None) -> Step:
    """Look for one more effect; add none where a model that diverges leaves no finite numbers.

    Parameters
    ----------
    held
        The last fit with its constants held to their tolerances, where that is known.
    """
    try:
        return _look(found, how, number, held)
    except (np.linalg.LinAlgError, FloatingPointError):
        return Step(found, added=0)


def _look(found: Hypothesis, how: SearchSettings, number: int, held: Fit | None) -> Step:
    """Look for one more effect beside those of a hypothesis."""
    before = found.last
    pulled = bool(moved_of(before))
    if found.effects and chi2_p_value(before) > NOTHING_LEFT_P_VALUE:
        if pulled:
            # Of parameters told only together, one may have stopped far from its claim.
            found = converge(found, found.given_effects, how.kinds)
            before = found.last
            pulled = bool(moved_of(before))
        if not pulled:
            return Step(found, added=0)
    if not pulled and leaves_too_little(found):
        return Step(found, added=0)
    held = held or refit_within_tolerances(before, found.trials)
    localized = locate(held, found.trials) if found.effects else None
    if localized is not None:
        relearnt = relearn_force(found, held, localized, how.kinds, how.monitor)
        if relearnt is not found:
            return _next(relearnt, how, number)
    lost = number > 0 and held.chi2_in_band > UNTRACKED_CHI2 and not how.options.quick
    begun = fit_later_segments(found, held, how) if lost else []
    if begun and begun[0].fit.chi2_in_band < LIMITS.far_off_chi2:
        rest = localized or locate(held, found.trials)
        found = dataclasses.replace(found, rest=rest, localized=found.localized or rest)
        return accept_best(found, held, begun, how, pulled=pulled)
    step = extend(found, held, how, number, pulled=pulled, begun=begun, localized=localized)
    step = _resolved(step, held, how, number)
    found = step.hypothesis
    # Another effect that is still missing may be what bends constants, and needs them so.
    over = number == 0 or held is before or found.final or found.holds is not None
    if step.added or over or how.monitor.is_late:
        return step
    return _resolved(extend(found, before, how, number, pulled=pulled), before, how, number)


def _resolved(step: Step, before: Fit, how: SearchSettings, number: int) -> Step:
    """Take account of a sensor that drifts, by what the others say."""
    if step.drift is None:
        return step
    return end_with_drift(step.hypothesis, before, step.drift, how, number, continue_search)


def _close(found: Hypothesis, how: SearchSettings, number: int) -> tuple[Hypothesis, bool]:
    """Return whether what was found is to be enough; then with what it leaves."""
    exhausted = how.monitor.is_late
    found = dataclasses.replace(found, exhausted=exhausted)
    enough = exhausted and (how.monitor.is_over or explains_all(found))
    if not enough and number < how.options.most - 1:
        return found, False
    how.monitor("looking at what is left", 0.9)
    return dataclasses.replace(found, rest=locate(found.last, found.trials)), True


def _suggest_holds(found: Hypothesis, how: SearchSettings) -> Hypothesis:
    """Suggest another hold of the inputs, under which what was found so far explains all.

    It is asked after each effect: a step that was taken for a curve looks like one more. Which
    effects there are has to be asked again, under that hold.
    """
    over = found.final or found.holds is not None or how.monitor.is_late
    over = over or not found.fits_whole_records
    if how.stated is None or over or not found.effects or explains_all(found):
        return found
    holds = held_otherwise(found.last, found.trials, how.kinds, how.stated)
    if holds is None or holds in how.asked:
        return found
    held = with_holds(found.last, holds, found.trials, how.kinds)
    if (
        held.chi2_in_band < LIMITS.explained_chi2
        or chi2_p_value(held) > LIMITS.coloured_p_value
    ):
        return dataclasses.replace(found, suggested_holds=holds)
    return found


def _begin_otherwise(
    found: Hypothesis, held: Fit, trials: tuple[Trial, ...], how: SearchSettings
) -> Hypothesis:
    """Begin with other effects, while much is left."""
    first = found.first
    cut = len(found.trials) != len(trials)
    again = found.holds is not None or found.suggested_holds is not None
    if not found.fitted or again or cut or explains_all(found):
        return found
    for other in alternative_starts(found, held, how.kinds, how.monitor):
        if found.suggested_holds is not None or explains_all(found):
            break
        if how.monitor.is_late:
            return dataclasses.replace(found, exhausted=True)
        terms = Terms(stated=how.stated, pulled=bool(moved_of(first)))
        start = Hypothesis((first,), trials, localized=found.localized)
        step = accept(start, held, [other], trials, how.kinds, terms)
        if step.added:
            found = better(found, continue_search(step.hypothesis, how, 1), how.kinds)
    return found


def _revise(found: Hypothesis, how: SearchSettings) -> Hypothesis:
    """Look for each of several effects again, and for what is missing then."""
    revised = substitute(found, how.kinds, how.stated, how.monitor)
    count = len(revised.effects)
    changed = [one.effect for one in revised.effects] != [one.effect for one in found.effects]
    if changed and count < how.options.most and not explains_all(revised):
        return continue_search(revised, how, count)
    return revised

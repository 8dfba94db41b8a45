"""The loop of a diagnosis: effects are added while the evidence rises.

`grow` is the loop: each effect is looked for in what the others leave (`next_effect`). Where
the first was named while another as strong was missing, it may be the wrong one, or stand in
the way: `search` begins again with the next that might have been first, as long as much is
left, and asks at the end whether each effect is needed beside the others.
"""

import dataclasses

from slowtime.discrepancy.calibration import BREAKDOWNS, Fit
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.candidates.measured_pairs import act_apart
from slowtime.discrepancy.combined_laws.search import explain_together, explains_most
from slowtime.discrepancy.estimation.input_hold import held_otherwise, with_holds
from slowtime.discrepancy.hypothesis import Hypothesis, SearchStep
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.quoting import moved_of
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refinement.substitution import generalize, substitute
from slowtime.discrepancy.selection.acceptance import Criteria, accept
from slowtime.discrepancy.selection.comparison import better, explains_all
from slowtime.discrepancy.thresholds import LIMITS

from .alternative_starts import alternative_starts
from .drifting_sensor import end_with_drift
from .next_effect import next_effect
from .settings import SearchSettings


def search(first: Fit, trials: tuple[Trial, ...], how: SearchSettings) -> Hypothesis:
    """Find the effects that a model lacks.

    While windows grow, the trials are parts of the records.
    """
    tolerated = None if how.options.quick else refit_within_tolerances(first, trials)
    # Combinations are of laws at one element each, and take longer than all else.
    apart = tolerated is not None and how.decays and act_apart(tolerated, trials, how.kinds)
    together = None
    if how.decays and not apart:
        together = explain_together(first, trials, how.kinds, how.monitor)
    if together is not None and (not together.effects or explains_most(together)):
        return together
    found = grow(Hypothesis((first,), trials), how, tolerated=tolerated)
    if tolerated is None:
        return found
    found = _begin_otherwise(found, tolerated, trials, how)
    if found.suggested_holds is not None:
        return found
    found = generalize(_revise(found, how), how.kinds, how.stated, how.monitor)
    return found if together is None else better(found, together, how.kinds)


def grow(
    found: Hypothesis, how: SearchSettings, number: int = 0, tolerated: Fit | None = None
) -> Hypothesis:
    """Add effects to a hypothesis one after the other, until none is missing.

    `tolerated` is the last fit with its constants held to their tolerances, where known.
    """
    while number < how.options.most:
        step = _step(found, how, number, tolerated)
        found, tolerated = step.hypothesis, None
        if step.again:
            continue
        if step.drift is not None:
            return end_with_drift(step, how, number, grow)
        if not step.added:
            break
        number += step.added
        if step.added == 1:
            found = _suggest_holds(found, how)
        if found.suggested_holds is not None:
            break
        found = dataclasses.replace(found, exhausted=how.monitor.is_late)
        enough = found.exhausted and (how.monitor.is_over or explains_all(found))
        if enough or number >= how.options.most:
            how.monitor("looking at what is left", 0.9)
            return dataclasses.replace(found, rest=locate(found.last, found.trials))
    return found


def _step(
    found: Hypothesis, how: SearchSettings, number: int, tolerated: Fit | None
) -> SearchStep:
    """Look for one more effect; none is there to a model that leaves no finite numbers."""
    try:
        return next_effect(found, how, number, tolerated)
    except BREAKDOWNS as error:
        how.monitor.note(f"The search for effect {number + 1} ended early: {error}.")
        return SearchStep(found, added=0)


def _suggest_holds(found: Hypothesis, how: SearchSettings) -> Hypothesis:
    """Suggest another hold of the inputs, under which what was found so far explains all."""
    # It is asked after each effect: a step that was taken for a curve looks like one more.
    # Which effects there are has to be asked again, under that hold.
    if found.final or found.holds is not None or how.monitor.is_late:
        return found
    if not found.fits_whole_records or how.stated is None:
        return found
    if not found.effects or explains_all(found):
        return found
    holds = held_otherwise(found.last, found.trials, how.kinds, how.stated)
    if holds is None or holds in how.asked:
        return found
    otherwise = with_holds(found.last, holds, found.trials, how.kinds)
    if (
        otherwise.chi2_in_band < LIMITS.explained_chi2
        or chi2_p_value(otherwise) > LIMITS.coloured_p_value
    ):
        return dataclasses.replace(found, suggested_holds=holds)
    return found


def _begin_otherwise(
    found: Hypothesis, tolerated: Fit, trials: tuple[Trial, ...], how: SearchSettings
) -> Hypothesis:
    """Begin with other effects, while much is left."""
    first = found.first
    cut = len(found.trials) != len(trials)
    again = found.holds is not None or found.suggested_holds is not None
    if not found.fitted or again or cut or explains_all(found):
        return found
    for other in alternative_starts(found, tolerated, how.kinds, how.monitor):
        if found.suggested_holds is not None or explains_all(found):
            break
        if how.monitor.is_late:
            return dataclasses.replace(found, exhausted=True)
        terms = Criteria(stated=how.stated, pulled=bool(moved_of(first)))
        start = Hypothesis((first,), trials, localized=found.localized)
        step = accept(start, tolerated, [other], trials, how.kinds, terms)
        if step.added:
            found = better(found, grow(step.hypothesis, how, 1), how.kinds)
    return found


def _revise(found: Hypothesis, how: SearchSettings) -> Hypothesis:
    """Look for each of several effects again, and for what is missing then."""
    revised = substitute(found, how.kinds, how.stated, how.monitor)
    count = len(revised.effects)
    changed = [one.effect for one in revised.effects] != [one.effect for one in found.effects]
    if changed and count < how.options.most and not explains_all(revised):
        return grow(revised, how, count)
    return revised

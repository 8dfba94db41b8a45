"""Several effects, found one by one, in; each looked for again beside the others, out.

What was named first was named while the others were missing: it may be a neighbour of the right
one, or stand for half of it and half of another. Beside the others it is the only one missing,
and is looked for as one is.
"""

import dataclasses
from collections.abc import Iterator, Mapping

import numpy as np

from slowtime.discrepancy.calibration.augmentation import fitted_effects, refit_without
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.candidates.library_fit import label_of, library_candidates
from slowtime.discrepancy.estimation.candidate_fit import (
    best_of_each_place,
    fit_candidates,
    fitted_effect,
    sds_of_strength,
)
from slowtime.discrepancy.estimation.input_hold import Hold
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import moved_of
from slowtime.discrepancy.selection.acceptance import accept, is_second_curve
from slowtime.discrepancy.selection.comparison import better
from slowtime.discrepancy.selection.probabilities import doubts_about
from slowtime.discrepancy.state import Found
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, Kind

from .elimination import eliminate, left_out

AS_LIKELY = -2.0
"""Log evidence by which fewer effects may be behind more."""
FAINTLY = 10.0
"""Standard deviations from nothing, below which a law of several numbers may be at the end of
its range; those that are not are so by fifty and more."""
OTHERS, KNOWN = 3, 2
"""Labels that are tried in the stead of one: those found beside the others, and those refitted
when it was."""


def substitute(
    found: Found, kinds: Mapping[str, Kind], stated: tuple[Hold, ...] | None, tell: Monitor
) -> Found:
    """Put others in the stead of effects, where that explains more; until nothing does.

    Parameters
    ----------
    stated
        What the model says of its inputs between samples; as it stands where not given.
    """
    if not worth_it(found, kinds):
        return found
    for number in _in_turn(found, kinds):
        # What does nothing of its own should not be told, late as it may be.
        needless = number in _faint(found, kinds)
        if tell.is_over or (tell.is_late and not needless):
            found.hurried = True
            return found
        branch = _anew(found, number, kinds, stated, tell)
        if branch is None:
            continue
        branch.fits, branch.answers = eliminate(
            branch.fits, branch.answers, branch.trials, kinds
        )
        fewer = len(branch.answers) < len(found.answers)
        enough = AS_LIKELY if fewer or needless else LIMITS.least_log_evidence
        if better(found, branch, kinds, enough) is not found:
            return substitute(branch, kinds, stated, tell)
    return found


def worth_it(found: Found, kinds: Mapping[str, Kind]) -> bool:
    """Whether several effects leave something, need constants that are off, or are many.

    Or one of them does next to nothing of its own.
    """
    last = found.fits[-1]
    whole = len(found.fits) == 1 + len(found.answers) and found.holds is None
    if len(found.answers) < 2 or found.ended or found.unheard or not whole:
        return False
    if any(len(fit.states) != len(found.trials) for fit in found.fits):
        return False
    much = (
        chi2_p_value(last) < LIMITS.coloured_p_value
        or bool(moved_of(last))
        or len(found.answers) > 2
    )
    return much or bool(_faint(found, kinds))


def _faint(found: Found, kinds: Mapping[str, Kind]) -> list[int]:
    """Give numbers of laws of several numbers, one of which is hardly more than its error.

    They are at the end of their range, where another law does what they do: what rides on a
    node and swings without damping is a tone.
    """
    last = found.fits[-1]
    own = len(last.plant.effects) - len(found.answers)
    return [
        number
        for number, answer in enumerate(found.answers)
        if len(answer.effect.parameters) > 1
        and sds_of_strength(last, own + number, kinds[answer.effect.kind]) < FAINTLY
    ]


def _in_turn(found: Found, kinds: Mapping[str, Kind]) -> Iterator[int]:
    """Give numbers of effects: those first that do nothing, or where something is left."""
    here = found.left.groups[0].places if found.left is not None else ()
    faint = _faint(found, kinds)
    numbers = range(len(found.answers))
    yield from sorted(
        numbers, key=lambda i: (i not in faint, found.answers[i].effect.place not in here)
    )


def _anew(
    found: Found,
    number: int,
    kinds: Mapping[str, Kind],
    stated: tuple[Hold, ...] | None,
    tell: Monitor,
) -> Found | None:
    """Look for one effect again beside the others; the account with what was found last."""
    own, last, trials = len(found.fits[0].plant.effects), found.fits[-1], found.trials
    known = fitted_effects(last)[own + number]
    tell(f"looking again at {known.kind} at {known.place}", 0.86)
    less = refit_without(last, own + number, trials, kinds)
    if less is None:
        return None
    others = [a for i, a in enumerate(found.answers) if i != number]
    branch = dataclasses.replace(
        found,
        fits=[found.fits[0], *left_out(found.fits, number, less, trials, kinds)],
        answers=others,
        undecided=next((doubt for a in others if (doubt := doubts_about(a))), ()),
        pair=None,
        retuned=False,
    )
    try:
        before = refit_within_tolerances(less, trials)
        located = locate(before, trials)
        tried = library_candidates(before, located, kinds)
    except (np.linalg.LinAlgError, FloatingPointError):
        return None
    branch.left = located
    tried = [one for one in tried if not is_second_curve(one.effect, others, kinds)]
    beside = best_of_each_place(tried, OTHERS)
    if not beside:
        return None
    # What was refitted counts for as good as the best, until it is so again.
    again = [dataclasses.replace(beside[0], effect=e, start=None) for e in _refitted(found)]
    own_label = dataclasses.replace(beside[0], effect=known, start=None)
    labels = {label_of(one.effect): one for one in reversed([own_label, *beside, *again])}

    def tick(effect: Effect, _: int) -> bool:
        tell(f"refitting {effect.kind} at {effect.place}", 0.86)
        return tell.is_over

    in_turn = list(reversed(labels.values()))
    named = fit_candidates(before, in_turn, trials, kinds, tick)
    pulled = bool(moved_of(less))
    if not accept(branch, before, named, trials, kinds, stated, pulled=pulled):
        return None
    if branch.holds is not None:
        return None
    branch.left = locate(branch.fits[-1], trials)
    return branch


def _refitted(found: Found) -> list[Effect]:
    """Give those that were refitted when the first was named, the best first."""
    named = {label_of(answer.effect) for answer in found.answers}
    rest = [one for one in found.named if label_of(one.effect) not in named]
    return [fitted_effect(one) for one in rest[:KNOWN]]

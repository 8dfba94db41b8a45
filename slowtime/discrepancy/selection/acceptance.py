"""What was refitted, in; whether it is what is missing, and the account with it, out."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import Fit, FitAbandoned, FitControl, cut_segments, refit
from slowtime.discrepancy.calibration.augmentation import carry_effect
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.candidates.constant_equivalents import (
    CONSTANTS,
    is_single_changed_constant,
)
from slowtime.discrepancy.candidates.parameter_scan import is_constant_change
from slowtime.discrepancy.data.clock_overrun import mask_clock_overrun
from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.discrepancy.estimation.candidate_fit import (
    FittedCandidate,
    is_significant,
    misfit,
    with_noise,
)
from slowtime.discrepancy.estimation.input_hold import (
    FAINT,
    Hold,
    held_as_well,
    held_instead,
    with_holds,
)
from slowtime.discrepancy.estimation.occam_factor import relief
from slowtime.discrepancy.estimation.shooting_fit import in_pieces
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.state import Found
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, Kind, Law

from .many_laws import variable_of
from .probabilities import answer_of, hardly_any, rivals_within, shares_of

SPECK = 0.01
"""Share of what is missing, by which a first effect that explains no more is not what is."""
SLIGHT = 1e-3
"""Share of what is missing, up to which a law of more numbers that explains no more than its
limit does is taken for it. Of friction that creeps where it should stick, Stribeck's law makes
up to 0.9e-3; of true Stribeck curves in twenty hidden cases, 1.35e-3 at least, 20e-3 mostly."""
MUCH = 0.2
"""Share of what was left that a second law at one place may leave, if more than noise."""
NESTED = {"stribeck": "coulomb"}
"""Laws, and the simpler ones that they become."""


def accept(
    found: Found,
    before: Fit,
    named: Sequence[FittedCandidate],
    trials: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
    stated: tuple[Hold, ...] | None,
    *,
    pulled: bool,
    twice: bool = False,
    asked: Sequence[tuple[Hold, ...] | None] | None = None,
    sure: bool = False,
    over: Callable[[], bool] = bool,
) -> bool:
    """Take the best of what was refitted, if it is worth it; whether it was.

    Parameters
    ----------
    before
        The fit that they were added to.
    named
        What was refitted, the best first.
    stated
        What the model says of its inputs between samples; as it stands where not given.
    pulled
        Whether constants have left their tolerances: that alone says that something is missing.
    twice
        Whether their place has an effect already.
    asked
        Under which holds effects were looked for; where given, another hold that explains as
        much comes before the effect.
    sure
        Whether it is there, however little it explains.
    over
        Once true, what it is compared with is taken as it was fitted last.
    """
    channels = tuple(s.channel for s in before.plant.description.sensors)
    short = in_pieces(named, kinds)
    states = before.states
    if short:
        named = short
        trials = cut_segments(before.plant, trials)[0]
        states = tuple(np.zeros(0) for _ in trials)
    named = [one for one in named if is_significant(one, trials, kinds)]
    if not named:
        return False
    best = named[0]
    try:
        bar = refit(
            before.plant, trials, noise=best.fit.noise, values=before.values,
            states=states, horizons=(1.0,), control=FitControl(is_late=None if short else over),
        )  # fmt: skip
    except FitAbandoned:
        bar = with_noise(before, best.fit.noise, trials)
    cut = any(len(fit.states) != len(trials) for fit in found.fits)
    holds = None if cut else held_instead(best.fit, bar, trials, kinds, stated)
    if holds is not None and asked is not None and found.answers and holds not in asked:
        found.otherwise = holds
        return False
    if holds is not None:
        found.holds = holds
        found.fits = [with_holds(fit, holds, found.trials, kinds) for fit in found.fits]
        return True
    # Where a constant has left its tolerance, something is missing; the question is what.
    constant = pulled and is_constant_change(kinds[best.effect.kind])
    least = 0.0 if constant else LIMITS.least_log_evidence
    lead = best.score - _bare(bar)
    if lead < least:
        return False
    if asked is not None and stated is not None and not (cut or short or over()):
        other = held_as_well(bar, best.fit.noise, lead, trials, kinds, stated)
        if other is not None and other not in asked:
            found.otherwise = other
            return False
    missing = bar.cost - bar.data
    named = _limits_first(named, missing)
    best = named[0]
    constant = pulled and is_constant_change(kinds[best.effect.kind])
    speck = _speck(found, best, bar, twice=twice) if found.answers else SPECK * missing
    if not (constant or sure) and bar.cost - best.fit.cost < speck:
        return False
    # That constants were claimed too well is an answer too, and has its share.
    alone = pulled and is_single_changed_constant(bar, best.effect)
    if alone:
        # What leaves the constant as far off is no other answer either.
        named = [one for one in named if one is best or not _still_off(one.fit, best.effect)]
    besides = [_retuned(bar)] if pulled and not alone else []
    shares = shares_of(named, kinds, besides, bar)
    if sum(shares) < 1 - LIMITS.decided_probability:
        return False
    # A constant that is off, and told as such, unless much is left where it is.
    slightly = max(map(abs, bar.constant_pulls.values()), default=0.0) < LIMITS.alone_tolerances
    slightly &= bar.chi2_in_band < LIMITS.explained_chi2
    if constant and (found.answers or slightly) and max(shares) < LIMITS.decided_probability:
        return False
    order = sorted(range(len(named)), key=lambda i: -shares[i])
    named, shares = [named[i] for i in order], [shares[i] for i in order]
    best = named[0]
    again = twice and not alone and chi2_p_value(best.fit) < LIMITS.coloured_p_value
    if again and not _explains_much(found, best, kinds):
        return False
    found.fits.append(best.fit)
    found.trials = mask_clock_overrun(
        trials if short else found.trials, channels, (best.effect,), kinds
    )
    found.answers.append(answer_of(named, shares, kinds))
    if shares[0] < LIMITS.decided_probability and not found.undecided:
        found.undecided = rivals_within(named, shares)
        found.pair = tuple(named[: len(found.undecided)])
        found.retuned = bool(besides) and 1 - sum(shares) > 1 - LIMITS.decided_probability
    return True


def _explains_much(found: Found, best: FittedCandidate, kinds: Mapping[str, Kind]) -> bool:
    """Whether a second law at a place takes most of what is left, and bends no curve."""
    own = variable_of(best.effect, kinds)
    there = [a.effect for a in found.answers if a.effect.place == best.effect.place]
    pieces = own is not None and any(variable_of(one, kinds) == own for one in there)
    first, last = found.fits[0], found.fits[-1]
    much = best.fit.chi2_in_band - 1 < MUCH * (last.chi2_in_band - 1)
    return much and not hardly_any(last, first) and not pieces


def _limits_first(named: Sequence[FittedCandidate], missing: float) -> list[FittedCandidate]:
    """Leave out the best where it explains next to nothing that its limit does not."""
    best, *others = named
    for other in others:
        limit = other.effect.kind == NESTED.get(best.effect.kind)
        if limit and other.effect.place == best.effect.place:
            gained = other.fit.cost - best.fit.cost
            if len(other.fit.states) == len(best.fit.states) and gained < SLIGHT * missing:
                rest = [one for one in others if one is not other]
                return [other, *rest]
    return [best, *others]


def _speck(found: Found, best: FittedCandidate, bar: Fit, *, twice: bool) -> float:
    """Chi squared that a later effect has to explain.

    Long records tell the least flaw of what was found first from noise; and of noise that is
    louder than it was taken to be, any law explains a speck, though none leaves it still.
    """
    fleck = LIMITS.negligible_share * _at_first(found, best)
    still = not twice and _clears(bar, best.fit)
    return fleck if still else max(FAINT * bar.data, fleck)


def _clears(bar: Fit, fit: Fit) -> bool:
    """Whether a fit leaves noise where something was heard, and much of it in band."""
    much = bar.chi2_in_band - fit.chi2_in_band > FAINT
    return (
        much
        and chi2_p_value(bar) < LIMITS.coloured_p_value
        and chi2_p_value(fit) > LIMITS.white_p_value
    )


def _at_first(found: Found, best: FittedCandidate) -> float:
    """Chi squared beyond the noise that was missing from the model as given."""
    first = found.fits[0]
    if len(first.states) != len(best.fit.states):
        return 0.0
    return misfit(first, best.fit.noise, found.trials) - best.fit.data


def end_with(
    found: Found,
    before: Fit,
    answer: NamedEffect,
    kinds: Mapping[str, Kind],
    carried: Effect | None = None,
) -> bool:
    """Take what no law follows, and look no further; False, as there is no more."""
    found.answers.append(answer)
    found.fits.append(carry_effect(before, carried or answer.effect, kinds))
    found.left, found.ended = None, True
    return False


def is_second_curve(
    effect: Effect, answers: Sequence[NamedEffect], kinds: Mapping[str, Kind]
) -> bool:
    """Whether an effect is of the family of one found at its place: a curve in pieces."""
    kind = kinds[effect.kind]
    switched = isinstance(kind.action, Law) and bool(kind.action.switches)
    if kind.quadrature is not None or switched:
        return False
    return any(
        answer.effect.place == effect.place and answer.family == kind.family
        for answer in answers
    )


def _still_off(fit: Fit, effect: Effect) -> bool:
    """Whether the constant that an effect changes is off in a fit without it."""
    pull = fit.pulls.get((CONSTANTS[effect.kind][0], effect.place.id), 0.0)
    return abs(pull) > LIMITS.moved_tolerances


def _retuned(fit: Fit) -> float:
    """Log evidence of constants whose tolerance was stated too small."""
    return _bare(fit) + float(relief(list(fit.constant_pulls.values())).sum())


def _bare(fit: Fit) -> float:
    """Log evidence of a fit whose effects stand."""
    numbers = sum(name[0] == "effect" for name in fit.prior.names)
    return float(-fit.cost / 2 - numbers / 2 * np.log(fit.data))

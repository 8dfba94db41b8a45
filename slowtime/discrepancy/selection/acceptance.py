"""Acceptance of a fitted candidate as an effect of the model."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import Fit, FitAbandoned, FitControl, cut_segments, refit
from slowtime.discrepancy.calibration.augmentation import carry_effect
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.candidates.constant_equivalents import (
    CONSTANTS,
    is_single_changed_constant,
)
from slowtime.discrepancy.candidates.library_fit import label_of
from slowtime.discrepancy.candidates.parameter_scan import is_constant_change
from slowtime.discrepancy.data.clock_overrun import mask_clock_overrun
from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.discrepancy.estimation.candidate_fit import limit_of
from slowtime.discrepancy.estimation.input_hold import (
    NOTICEABLE_POWER,
    Hold,
    held_as_well,
    held_instead,
    with_holds,
)
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate, misfit, with_noise
from slowtime.discrepancy.estimation.occam_factor import relief
from slowtime.discrepancy.estimation.shooting_fit import in_pieces
from slowtime.discrepancy.estimation.significance import is_significant
from slowtime.discrepancy.hypothesis import Hypothesis, SearchStep
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, Kind, Law

from .many_laws import variable_of
from .probabilities import answer_of, hardly_any, rivals_within, shares_of

MIN_FIRST_SHARE = 0.01
"""[share of what is missing] That a first effect has to explain. Source:
docs/decisions/0021."""
MIN_NESTED_GAIN = 1e-3
"""[share of what is missing] That a law must explain beyond the simpler law it contains.
Source: docs/decisions/0027; where friction creeps, Stribeck's law explains up to 0.9e-3, in
twenty hidden cases with true Stribeck friction 1.35e-3 at least."""
MAX_SECOND_REST = 0.2
"""[share of what the first law left beyond noise] That a second law at one place may leave, if
more than noise. Source: docs/what_decides.md: half and double change no answer."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Criteria:
    """Under which terms a candidate is accepted as an effect.

    Parameters
    ----------
    stated
        What the model says of its inputs between samples; as it stands where not given.
    pulled
        Whether constants have left their tolerances: that alone says that something is missing.
    same_place
        Whether the place of the candidate has an effect already.
    asked
        Holds under which effects were looked for; where given, another hold that explains as
        much comes before the effect.
    certain
        Whether it is there, however little it explains.
    over
        Once true, what it is compared with is taken as it was fitted last.
    """

    stated: tuple[Hold, ...] | None
    pulled: bool
    same_place: bool = False
    asked: Sequence[tuple[Hold, ...] | None] | None = None
    certain: bool = False
    over: Callable[[], bool] = bool


def accept(
    hypothesis: Hypothesis,
    before: Fit,
    fitted: Sequence[FittedCandidate],
    trials: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
    terms: Criteria,
) -> SearchStep:
    """Add the best of the fitted candidates as an effect, if it is worth its parameters.

    The step has the effect, or another hold of the inputs instead of it; or suggests one.
    """
    short = in_pieces(fitted, kinds)
    states = before.states
    if short:
        fitted = short
        trials = cut_segments(before.plant, trials)[0]
        states = tuple(np.zeros(0) for _ in trials)
    fitted = [one for one in fitted if is_significant(one, trials, kinds)]
    if not fitted:
        return SearchStep(hypothesis, added=0)
    best = fitted[0]
    try:
        bare = refit(
            before.plant, trials, noise=best.fit.noise, values=before.values,
            states=states, horizons=(1.0,),
            control=FitControl(is_late=None if short else terms.over),
        )  # fmt: skip
    except FitAbandoned:
        bare = with_noise(before, best.fit.noise, trials)
    held = _by_another_hold(hypothesis, best, bare, trials, kinds, terms, short=bool(short))
    if held is not None:
        return held
    ranked = _worth_it(hypothesis, fitted, bare, kinds, terms)
    if ranked is None:
        return SearchStep(hypothesis, added=0)
    fitted, shares, constants = ranked
    best = fitted[0]
    channels = tuple(s.channel for s in before.plant.description.sensors)
    grown = dataclasses.replace(
        hypothesis.with_effect(best.fit, answer_of(fitted, shares, kinds)),
        trials=mask_clock_overrun(
            trials if short else hypothesis.trials, channels, (best.effect,), kinds
        ),
    )
    if shares[0] < LIMITS.decided_probability and not hypothesis.undecided:
        rivals = rivals_within(fitted, shares)
        grown = dataclasses.replace(
            grown,
            undecided=rivals,
            pair=tuple(fitted[: len(rivals)]),
            constants_suffice=constants and 1 - sum(shares) > 1 - LIMITS.decided_probability,
        )
    return SearchStep(grown, added=1)


def _by_another_hold(
    hypothesis: Hypothesis,
    best: FittedCandidate,
    bare: Fit,
    trials: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
    terms: Criteria,
    *,
    short: bool,
) -> SearchStep | None:
    """Take or suggest another hold of the inputs, where that explains what an effect would."""
    whole = all(len(fit.states) == len(trials) for fit in hypothesis.fits)
    holds = held_instead(best.fit, bare, trials, kinds, terms.stated) if whole else None
    if holds is not None:
        if terms.asked is not None and hypothesis.effects and holds not in terms.asked:
            return SearchStep(dataclasses.replace(hypothesis, suggested_holds=holds), added=0)
        fits = tuple(
            with_holds(fit, holds, hypothesis.trials, kinds) for fit in hypothesis.fits
        )
        return SearchStep(dataclasses.replace(hypothesis, holds=holds, fits=fits), added=1)
    lead = best.score - _bare(bare)
    if lead < _least_lead(best, kinds, terms):
        return SearchStep(hypothesis, added=0)
    asked, stated = terms.asked, terms.stated
    if asked is None or stated is None or not whole or short or terms.over():
        return None
    other = held_as_well(bare, best.fit.noise, lead, trials, kinds, stated)
    if other is not None and other not in asked:
        return SearchStep(dataclasses.replace(hypothesis, suggested_holds=other), added=0)
    return None


def _least_lead(best: FittedCandidate, kinds: Mapping[str, Kind], terms: Criteria) -> float:
    """Log evidence that the best candidate has to bring."""
    # Where a constant has left its tolerance, something is missing; the question is what.
    constant = terms.pulled and is_constant_change(kinds[best.effect.kind])
    return 0.0 if constant else LIMITS.least_log_evidence


def _worth_it(
    hypothesis: Hypothesis,
    fitted: Sequence[FittedCandidate],
    bare: Fit,
    kinds: Mapping[str, Kind],
    terms: Criteria,
) -> tuple[list[FittedCandidate], list[float], bool] | None:
    """Rank candidates, with their probabilities; None where the best is not worth being told.

    Says, too, whether constants took part whose tolerance was stated too small.
    """
    missing = bare.cost - bare.data
    fitted = _limits_first(fitted, missing)
    best = fitted[0]
    constant = terms.pulled and is_constant_change(kinds[best.effect.kind])
    least = (
        _least_gain(hypothesis, best, bare, same_place=terms.same_place)
        if hypothesis.effects
        else MIN_FIRST_SHARE * missing
    )
    if not (constant or terms.certain) and bare.cost - best.fit.cost < least:
        return None
    # That constants were claimed too well is an answer too, and has its share.
    alone = terms.pulled and is_single_changed_constant(bare, best.effect)
    if alone:
        # What leaves the constant as far off is no other answer either.
        fitted = [one for one in fitted if one is best or not _still_off(one.fit, best.effect)]
    besides = []
    if terms.pulled and not alone:
        besides.append(_bare(bare) + float(relief(list(bare.constant_pulls.values())).sum()))
    shares = shares_of(fitted, kinds, besides, bare)
    if sum(shares) < 1 - LIMITS.decided_probability:
        return None
    # A constant that is off, and told as such, unless much is left where it is.
    slightly = (
        max(map(abs, bare.constant_pulls.values()), default=0.0) < LIMITS.alone_tolerances
    )
    slightly &= bare.chi2_in_band < LIMITS.explained_chi2
    if (
        constant
        and (hypothesis.effects or slightly)
        and max(shares) < LIMITS.decided_probability
    ):
        return None
    order = sorted(range(len(fitted)), key=lambda i: -shares[i])
    fitted, shares = [fitted[i] for i in order], [shares[i] for i in order]
    again = terms.same_place and not alone
    again &= chi2_p_value(fitted[0].fit) < LIMITS.coloured_p_value
    if again and not _explains_much(hypothesis, fitted[0], kinds):
        return None
    return fitted, shares, bool(besides)


def _explains_much(
    hypothesis: Hypothesis, best: FittedCandidate, kinds: Mapping[str, Kind]
) -> bool:
    """Whether a second law at a place takes most of what is left, and bends no curve."""
    own = variable_of(best.effect, kinds)
    there = [a.effect for a in hypothesis.effects if a.effect.place == best.effect.place]
    same_variable = own is not None and any(variable_of(one, kinds) == own for one in there)
    first, last = hypothesis.first, hypothesis.last
    much = best.fit.chi2_in_band - 1 < MAX_SECOND_REST * (last.chi2_in_band - 1)
    return much and not hardly_any(last, first) and not same_variable


def _limits_first(named: Sequence[FittedCandidate], missing: float) -> list[FittedCandidate]:
    """Leave out the best where it explains next to nothing that its limit does not."""
    best, *others = named
    for other in others:
        if label_of(other.effect) == limit_of(best.effect):
            gained = other.fit.cost - best.fit.cost
            if (
                len(other.fit.states) == len(best.fit.states)
                and gained < MIN_NESTED_GAIN * missing
            ):
                rest = [one for one in others if one is not other]
                return [other, *rest]
    return [best, *others]


def _least_gain(
    hypothesis: Hypothesis, best: FittedCandidate, bare: Fit, *, same_place: bool
) -> float:
    """Chi squared that a later effect has to explain."""
    # Long records tell the least flaw of what was found first from noise; and of noise that is
    # louder than it was taken to be, any law explains a speck, though none leaves it still.
    negligible = LIMITS.negligible_share * _missing_at_first(hypothesis, best)
    leaves_noise = not same_place and _clears(bare, best.fit)
    return negligible if leaves_noise else max(NOTICEABLE_POWER * bare.data, negligible)


def _clears(bare: Fit, fit: Fit) -> bool:
    """Whether a fit leaves noise where something was heard, and much of it in band."""
    much = bare.chi2_in_band - fit.chi2_in_band > NOTICEABLE_POWER
    return (
        much
        and chi2_p_value(bare) < LIMITS.coloured_p_value
        and chi2_p_value(fit) > LIMITS.white_p_value
    )


def _missing_at_first(hypothesis: Hypothesis, best: FittedCandidate) -> float:
    """Chi squared beyond the noise that was missing from the model as given."""
    first = hypothesis.first
    if len(first.states) != len(best.fit.states):
        return 0.0
    return misfit(first, best.fit.noise, hypothesis.trials) - best.fit.data


def end_with(
    hypothesis: Hypothesis,
    before: Fit,
    effect: NamedEffect,
    kinds: Mapping[str, Kind],
    carried: Effect | None = None,
) -> SearchStep:
    """Add an effect that follows no law, after which nothing more can be found."""
    fit = carry_effect(before, carried or effect.effect, kinds)
    grown = dataclasses.replace(hypothesis.with_effect(fit, effect), rest=None, final=True)
    return SearchStep(grown, added=0)


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


def _bare(fit: Fit) -> float:
    """Log evidence of a fit whose effects stand."""
    numbers = sum(name[0] == "effect" for name in fit.prior.names)
    return float(-fit.cost / 2 - numbers / 2 * np.log(fit.data))

"""Backward elimination of effects that the later ones have made needless.

What was named first was named while the others were still missing: once they are in, it may
have nothing left to explain, and its parameters are not those of the model that has them all.
"""

import dataclasses
from collections.abc import Mapping, Sequence

from slowtime.discrepancy.calibration import WRONG_MODEL_CHI2, Fit, refit, try_refit
from slowtime.discrepancy.calibration.augmentation import (
    carry_effect,
    described_effects,
    refit_without,
)
from slowtime.discrepancy.candidates.constant_equivalents import is_single_changed_constant
from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.discrepancy.estimation.candidate_fit import GROWING_HORIZONS
from slowtime.discrepancy.estimation.model_evidence import evidence
from slowtime.discrepancy.estimation.significance import sds_of_strength
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.quoting import requote_all
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.selection.probabilities import first_doubts
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Kind, Unmeasured


def eliminate_needless(
    found: Hypothesis, trials: tuple[Trial, ...], kinds: Mapping[str, Kind]
) -> Hypothesis:
    """Drop effects that the later ones have made needless, and doubts about them."""
    before = {(one.effect.kind, one.effect.place) for one in found.effects}
    places = [one.effect.place for one in found.effects]
    if found.final and places[-1].kind == "sensor" and places.count(places[-1]) == 1:
        # A drift without a law is in the model by name only, explains nothing, and stays;
        # unless another fault of its sensor was named, which a drift may make needless.
        drift, last = found.effects[-1], described_effects(found.last.plant.description)[-1]
        fits, effects = eliminate(found.fits[:-1], found.effects[:-1], trials, kinds)
        found = found.with_effects(
            [*fits, carry_effect(fits[-1], last, kinds)], [*effects, drift]
        )
    else:
        found = found.with_effects(*eliminate(found.fits, found.effects, trials, kinds))
    gone = before - {(one.effect.kind, one.effect.place) for one in found.effects}
    if any((rival.effect, rival.place) in gone for rival in found.undecided[:1]):
        found = dataclasses.replace(found, undecided=first_doubts(found.effects), pair=None)
    return found


def eliminate(
    fits: Sequence[Fit],
    answers: Sequence[NamedEffect],
    trials: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
) -> tuple[list[Fit], list[NamedEffect]]:
    """Leave out effects without which the rest does as well; quote the last fit."""
    chain, kept = list(fits), list(answers)
    if len(kept) < 2 or any(isinstance(kinds[a.effect.kind].action, Unmeasured) for a in kept):
        return chain, kept
    own = len(fits[0].plant.effects)
    number = 0
    while number < len(kept) and len(kept) > 1:
        less = refit_without(chain[-1], own + number, trials, kinds)
        if less is not None and _lost(less, chain[-1], own + number, kinds):
            less = _regrown(less, trials)
        if (
            less is None
            or is_single_changed_constant(less, kept[number].effect)
            or _gain(chain[-1], less, trials, kinds) >= LIMITS.least_log_evidence
        ):
            number += 1
            continue
        del kept[number]
        chain = [chain[0], *left_out(chain, number, less, trials, kinds)]
        number = 0
    return chain, requote_all(kept, chain[-1], kinds)


def _lost(less: Fit, more: Fit, number: int, kinds: Mapping[str, Kind]) -> bool:
    """Whether a model is far off for want of a law that does next to nothing."""
    # What tips over goes another way for a thousandth of its mass; then the fit without the law
    # is in a minimum of its own.
    kind = kinds[more.plant.effects[number].kind]
    faint = sds_of_strength(more, number, kind) < LIMITS.clear_sds
    return faint and more.chi2_in_band < WRONG_MODEL_CHI2 < less.chi2_in_band


def _regrown(fit: Fit, trials: tuple[Trial, ...]) -> Fit:
    """Fit a model to ever longer parts of the records; the better of both."""
    again = try_refit(
        fit.plant, trials, noise=fit.noise, values=fit.values, states=fit.states,
        horizons=GROWING_HORIZONS,
    )  # fmt: skip
    return fit if again is None or again.cost >= fit.cost else again


def _gain(more: Fit, less: Fit, trials: tuple[Trial, ...], kinds: Mapping[str, Kind]) -> float:
    """Log evidence of the larger model over the smaller, by one noise and the same data."""
    same = more
    # What a clock that is off leaves without an end is out of the data while one is tried.
    if less.noise is not more.noise or less.data != more.data:
        same = refit(
            more.plant, trials, noise=less.noise, values=more.values, states=more.states,
            horizons=(1.0,),
        )  # fmt: skip
    return evidence(same, kinds) - evidence(less, kinds)


def left_out(
    chain: Sequence[Fit],
    number: int,
    less: Fit,
    trials: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
) -> list[Fit]:
    """Fits after each effect that is left: those before the one that went are still good."""
    count = len(less.plant.effects) - len(chain[0].plant.effects)
    good = chain[1 : min(number + 1, count)]
    missing: list[Fit] = [less]
    while len(good) + len(missing) < count:
        shorter = refit_without(missing[0], len(missing[0].plant.effects) - 1, trials, kinds)
        if shorter is None:
            break
        missing.insert(0, shorter)
    return [*good, *missing]

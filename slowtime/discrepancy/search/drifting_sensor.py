"""Effects beside a sensor whose slow error follows no law, found by the other sensors."""

import dataclasses
from collections.abc import Callable

from slowtime.discrepancy.calibration import Fit, FitControl, try_refit
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.discrepancy.hypothesis import Hypothesis, SearchStep
from slowtime.discrepancy.proposers.sensor_drift import with_sensor_again, without_sensor
from slowtime.discrepancy.selection.acceptance import end_with

from .settings import SearchSettings

Grow = Callable[[Hypothesis, SearchSettings, int], Hypothesis]


def end_with_drift(
    step: SearchStep, how: SearchSettings, number: int, grow: Grow
) -> Hypothesis:
    """Name a drift that is on no law's course, and what the other sensors say beside it."""
    found, before, drift = step.hypothesis, step.base, step.drift
    assert before is not None
    assert drift is not None
    still = dict.fromkeys(drift.effect.parameters, 0.0)
    silent = dataclasses.replace(drift.effect, parameters=still)
    found, before = _by_the_others(found, before, drift, how, number, grow)
    if found.effects and all(_is_mean_of(one, drift) for one in found.effects):
        found = found.with_effects(found.fits[:1], ())
        before = refit_within_tolerances(found.first, found.trials)
    return end_with(found, before, drift, how.kinds, silent).hypothesis


def _is_mean_of(named: NamedEffect, drift: NamedEffect) -> bool:
    """Return whether a sensor was said to be off by the mean of its drift."""
    own = named.effect.place == drift.effect.place
    return own and named.effect.kind == "sensor_bias"


def _by_the_others(
    found: Hypothesis,
    before: Fit,
    drift: NamedEffect,
    how: SearchSettings,
    number: int,
    grow: Grow,
) -> tuple[Hypothesis, Fit]:
    """Look for what is missing beside a sensor that drifts, by all that the others say."""
    place = drift.effect.place
    trials = without_sensor(before, found.trials, place.id)
    # What the sensor was said to be off by was the mean of its drift.
    kept = tuple(one for one in found.effects if one.effect.place != place)
    own = len(found.effects) - len(kept)
    whole = found.first if own else before
    number += 1 - own
    if (
        (own and kept)
        or number >= how.options.most
        or not any(trial.used.any() for trial in trials)
    ):
        return found, before
    first = try_refit(
        whole.plant, trials, values=whole.values, states=whole.states,
        horizons=(1.0,), control=FitControl(is_late=lambda: how.monitor.is_late),
    )  # fmt: skip
    if first is None:
        exhausted = found.exhausted or how.monitor.is_late
        return dataclasses.replace(found, exhausted=exhausted), before
    rest = grow(Hypothesis((first,), trials, effects=kept), how, number)
    found = dataclasses.replace(found, exhausted=found.exhausted or rest.exhausted)
    fresh = rest.effects[len(kept) :]
    cut = len(rest.trials) != len(trials)
    if not fresh or rest.final or rest.holds is not None or cut:
        return found, before
    again = (with_sensor_again(fit, before, place.id) for fit in rest.fits[1:])
    fits = (*found.fits[: len(found.fits) - own], *again)
    found = dataclasses.replace(
        found.with_effects(fits, (*kept, *fresh)),
        without_sensor=True,
        localized=found.localized if kept else rest.localized,
    )
    if not found.undecided:
        found = dataclasses.replace(
            found, undecided=rest.undecided, pair=rest.pair,
            constants_suffice=rest.constants_suffice,
        )  # fmt: skip
    return found, found.last

"""Estimation of the hold of inputs between samples: band-limited, first-order, zero-order.

A recorded force is the signal itself below half the sampling rate, or what a converter held
until the next sample, or a straight line that somebody's simulation drew. A step is late by
half a sample: in a free run that is met to a thousandth, the wrong hold is something missing.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from slowtime.discrepancy.calibration import attempt
from slowtime.discrepancy.calibration.augmentation import with_effect
from slowtime.discrepancy.calibration.fit import Fit, referred_to, refit
from slowtime.discrepancy.localization import Localization, likeliest_places, locate
from slowtime.discrepancy.noise import Noise
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.workers import map_shared
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Effect, Kind, Place
from slowtime.dynamics.plant import Plant

Hold = Literal["band_limited", "first", "zero"] | None
OTHERS: tuple[Hold, ...] = ("first", "zero")
WORDS = {
    "band_limited": "the signal without anything above half the sampling rate",
    "first": "a straight line (first-order hold)",
    "zero": "held at the last one (zero-order hold)",
}
RIVALS = {"input_delay": "delay_s", "input_gain": "gain"}
"""What an input does that looks like another hold, and by which number."""
EXPLAINED_SDS = 3.0
"""[standard deviations of chi squared] Within which a model explains all, and no other hold is
sought. Source: three-sigma rule."""
MAX_READINGS = 30_000
"""[samples of all sensors] Of the record by which holds are compared. Source: a bound on
computing time."""
MIN_COMPARED_SAMPLES = 1000
"""[samples] Of that record at least. Source: docs/what_decides.md: half and double change no
answer."""
LIKELY_PLACES = 8
"""[places] The likeliest by one linearisation, among which those are found. Source: a bound on
computing time."""
COMPARED_PLACES = 3
"""[places] The most probable under the assumed hold, where holds are compared. Source: a bound
on computing time."""
NOTICEABLE_POWER = 0.05
"""[share of the noise power] From which a difference between fits matters. Source:
docs/decisions/0030."""
DECISIVE_LOG_LIKELIHOOD = 20.0
"""[nats] By which another hold has to be better. Source: docs/what_decides.md: half and double
change no answer."""
FAULT_LOG_LIKELIHOOD = 5.0
"""[nats] By which a fault of an input or another effect has to do better than another hold, and
another hold better than one that leaves only noise. Source: very strong evidence by Kass and
Raftery (1995)."""
MAX_REST_SHARE = 0.7
"""[share of what the best force leaves beyond noise] That is left under another hold at most,
where no single force explains the records. Source: docs/what_decides.md: half and double change
no answer."""
HOLD_ERROR_CHI2 = 5.0
"""[noise variances] Mean square in band up to which a wrong hold may be all that is missing.
Source: docs/what_decides.md: half and double change no answer."""


def found_holds(
    fit: Fit, trials: Sequence[Trial], kinds: Mapping[str, Kind]
) -> tuple[Hold, ...] | None:
    """Say which hold explains the records better than that of a fit; None where none does."""
    # Holds are compared where something else may be missing, too: by what is left with any
    # force at the likeliest place, of the record of which the model explains most.
    description = fit.plant.description
    explained = fit.chi2_in_band < 1 + EXPLAINED_SDS * fit.in_band_sd
    if explained or all(entry.hold is not None for entry in description.inputs):
        return None
    number = min(range(len(trials)), key=lambda i: _share(fit, trials[i], i))
    state = fit.states[number]
    count = max(MAX_READINGS // len(description.sensors), MIN_COMPARED_SAMPLES)
    trial = trials[number].part(0, count).trimmed()

    def located(described: Description, among: Sequence[Place] = ()) -> Localization:
        plant = Plant.of(described, kinds=kinds)
        values = np.concatenate([fit.values, plant.values[len(fit.values) :]])
        again = refit(plant, [trial], values=values, states=[state], horizons=(1.0,))
        return locate(again, [trial], among or likeliest_places(again, [trial], LIKELY_PLACES))

    def told(described: Description) -> tuple[float, float]:
        """Log likelihood, and what the best force leaves over the noise."""
        one = attempt(located, described, places)
        if one is None:
            return -np.inf, np.inf
        return one.log_likelihood, min(group.left for group in one.groups)

    def likelihood(described: Description) -> float:
        return told(described)[0]

    found = attempt(located, description)
    if found is None:
        return None
    places = [group.places[0] for group in found.groups[:COMPARED_PLACES]]
    stated = [entry.hold for entry in description.inputs]
    held = [describe_holds(description, [own or hold for own in stated]) for hold in OTHERS]
    tried = [told(one) for one in held]
    most, leaves = max(tried)
    if most < found.log_likelihood + DECISIVE_LOG_LIKELIHOOD:
        return None
    # Where no force does it, a little less is left under any hold but the right one, too.
    least = min(group.left for group in found.groups)
    if least > LIMITS.several_forces_chi2 and leaves - 1 > MAX_REST_SHARE * (least - 1):
        return None
    other = held[tried.index((most, leaves))]

    def faulty(described: Description) -> float:
        tried = [
            likelihood(_faulty(described, kind, trial.rate_hz))
            for kind in RIVALS
            if kind in kinds
        ]
        return max(tried, default=-np.inf) - FAULT_LOG_LIKELIHOOD

    as_given = faulty(description)
    # Both may be: another hold, and a fault that is seen well only once the hold is right.
    if as_given > most and as_given + DECISIVE_LOG_LIKELIHOOD > faulty(other):
        return None
    return tuple(entry.hold for entry in other.inputs)


def held_instead(
    faulty: Fit,
    before: Fit,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    stated: Sequence[Hold] | None = None,
) -> tuple[Hold, ...] | None:
    """Say which hold does as well as the fault of an input that was found last."""
    # A hold that was found while more was missing may have been the wrong one: a fault that
    # undoes it is no fault.
    inputs = before.plant.description.inputs
    known = [entry.hold for entry in inputs] if stated is None else stated
    if None not in known or faulty.plant.effects[-1].kind not in RIVALS:
        return None
    now = [entry.hold for entry in inputs]
    tried = [[one or hold for one in known] for hold in (*OTHERS, "band_limited")]
    supposed = [one or "band_limited" for one in now]
    others = [
        with_holds(before, holds, trials, kinds, faulty.noise)
        for holds in tried
        if holds != supposed
    ]
    # What says least of the input stands where others do not do clearly better.
    least = others[-1]
    for other in others[:-1]:
        least = other if other.cost < least.cost - 2 * DECISIVE_LOG_LIKELIHOOD else least
    if least.cost > faulty.cost + NOTICEABLE_POWER * faulty.data:
        return None
    return tuple(entry.hold for entry in least.plant.description.inputs)


def held_as_well(
    before: Fit,
    noise: Noise,
    lead: float,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    stated: Sequence[Hold],
) -> tuple[Hold, ...] | None:
    """Say under which hold a model explains as much as it does with one effect more."""
    # A straight line that was taken for a curve makes loads a little too strong: with little
    # else missing, any effect that grows with frequency looks like that.
    if None not in stated or before.chi2_in_band > HOLD_ERROR_CHI2:
        return None
    held = min(_others(before, noise, trials, kinds, stated), key=lambda fit: fit.cost)
    if (before.cost - held.cost) / 2 < lead - FAULT_LOG_LIKELIHOOD:
        return None
    return tuple(entry.hold for entry in held.plant.description.inputs)


def held_better(
    last: Fit, trials: Sequence[Trial], kinds: Mapping[str, Kind], stated: Sequence[Hold]
) -> tuple[Hold, ...] | None:
    """Say which hold does a little better than that of a fit which leaves but noise."""
    if None not in stated:
        return None
    best = min(_others(last, last.noise, trials, kinds, stated), key=lambda fit: fit.cost)
    if best.cost + 2 * FAULT_LOG_LIKELIHOOD > last.cost:
        return None
    return tuple(entry.hold for entry in best.plant.description.inputs)


def _others(
    last: Fit,
    noise: Noise,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    stated: Sequence[Hold],
) -> list[Fit]:
    """Fit the same model under every other hold; what says least of the input comes last."""
    now = [entry.hold or "band_limited" for entry in last.plant.description.inputs]
    tried = [[one or hold for one in stated] for hold in (*OTHERS, "band_limited")]

    def fit_held(holds: Sequence[Hold]) -> Fit | None:
        return attempt(with_holds, last, holds, trials, kinds, noise)

    shared = (*referred_to(last, trials), kinds, *kinds.values(), noise)
    others = map_shared(fit_held, [holds for holds in tried if holds != now], shared)
    return [other for other in others if other is not None] or [last]


def held_otherwise(
    last: Fit, trials: Sequence[Trial], kinds: Mapping[str, Kind], stated: Sequence[Hold]
) -> tuple[Hold, ...] | None:
    """Say which hold does better than that of a fit with all effects in; None without one."""
    # Where much is missing, forces at the likeliest places may look alike under all holds.
    if None not in stated or last.chi2_in_band < 1 + EXPLAINED_SDS * last.in_band_sd:
        return None
    others = _others(last, last.noise, trials, kinds, stated)
    best = min(others, key=lambda fit: fit.cost)
    margin = 2 * DECISIVE_LOG_LIKELIHOOD * max(best.chi2_in_band, 1.0)
    if best.cost + margin > last.cost:
        return None
    # Of two that do about as well, the one stands that says least of the input: the last.
    best = others[-1] if others[-1].cost < best.cost + margin else best
    return tuple(entry.hold for entry in best.plant.description.inputs)


def with_holds(
    fit: Fit,
    holds: Sequence[Hold],
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    noise: Noise | None = None,
) -> Fit:
    """Fit the same model to the same records with other holds, one for each input."""
    plant = Plant.of(describe_holds(fit.plant.description, holds), kinds=kinds)
    return refit(
        plant, trials, noise=noise, values=fit.values, states=fit.states, horizons=(1.0,)
    )


def describe_holds(description: Description, holds: Sequence[Hold]) -> Description:
    """Write into a description what its inputs do between samples."""
    inputs = tuple(
        dataclasses.replace(entry, hold=hold)
        for entry, hold in zip(description.inputs, holds, strict=True)
    )
    return dataclasses.replace(description, inputs=inputs)


def _share(fit: Fit, trial: Trial, number: int) -> float:
    """Share of the power of a trial that a fit leaves, the mean over its sensors."""
    left = np.sum(fit.residual[number] ** 2, axis=0)
    whole = np.sum((trial.measured - trial.measured.mean(axis=0)) ** 2, axis=0)
    return float(np.mean(left / np.maximum(whole, np.finfo(float).tiny)))


def _faulty(description: Description, kind: str, rate_hz: float) -> Description:
    """Give every input a fault, none to begin with but for half a sample of delay."""
    start = 0.5 / rate_hz if kind == "input_delay" else 1.0
    for entry in description.inputs:
        place = Place("input", entry.channel)
        description = with_effect(description, Effect(kind, place, {RIVALS[kind]: start}))
    return description


def saying_holds(description: Description) -> Description:
    """Write out what an input was taken to do between samples where nothing was said of it."""
    return describe_holds(
        description, [entry.hold or "band_limited" for entry in description.inputs]
    )


def told_of_holds(description: Description) -> tuple[str, ...]:
    """Say of each input what it does between samples, where that is known."""
    return tuple(
        f"Between samples, input {entry.channel} is {WORDS[entry.hold]}."
        for entry in description.inputs
        if entry.hold is not None
    )

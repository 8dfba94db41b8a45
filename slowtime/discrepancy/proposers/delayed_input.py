"""A force that no law makes, in; what is seen once a channel may be out of time, out.

A late input puts every mode out of phase. What another effect does beside it is then seen at no
place, or at a wrong one, and no law explains it: the delay has to be put right first, though
the free run is no better for it alone. And of few sensors, one whose clock runs slow is more
periods behind than one by the end: constants go to meet it half way, and no force is where it
seems to be.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.candidates.library_fit import Candidate, label_of, library_candidates
from slowtime.discrepancy.estimation.candidate_fit import (
    GRADUALLY,
    FittedCandidate,
    fit_candidate,
    fitted_effect,
)
from slowtime.discrepancy.localization import Localization, locate
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, Kind, Place

LATE, CLOCK = "input_delay", "sensor_clock"
"""Kinds of a late input, and of a sensor whose clock runs fast or slow."""
SKEWED = 1e-4
"""By what a clock is off from where it is looked for, either way."""
OPAQUE, CLEARLY = 0.5, 0.2
"""Share of a force that the best law leaves, from which none is seen; and up to which one is,
once an input may be late. Of two hidden pairs 0.56 and 0.78 before, 0.10 and 0.01 after."""
MOSTLY, FAR = 0.01, 0.1
"""Share of what is missing that a clock may leave for another effect, and of what each other
clock leaves. Of a hidden clock beside a spring that was softer 4e-4, and 3e-3 of the others."""
MOST = 2
"""Laws that are given for each input."""


def seen_beside_late(
    before: Fit,
    tried: Sequence[Candidate],
    trials: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
) -> Iterator[tuple[Candidate, Candidate]]:
    """Give a delay of an input and a law each, where the law is seen only beside that.

    Parameters
    ----------
    tried
        Laws with what they explain of the force as it is located without, the best first.
    """
    if LATE not in kinds or not _opaque(tried):
        return
    there = {label_of(effect) for effect in before.plant.effects}
    for entry in before.plant.description.inputs:
        place = Place("input", entry.channel)
        if (LATE, place) in there:
            continue
        begin = Effect(LATE, place, {kinds[LATE].names[0]: 0.5 / trials[0].rate_hz})
        named = fit_candidate(before, begin, trials, kinds, None)
        if named is None:
            continue
        delay = fitted_effect(named)
        try:
            held = refit_within_tolerances(named.fit, trials)
            seen = library_candidates(held, locate(held, trials), kinds)
        except (np.linalg.LinAlgError, FloatingPointError):
            continue
        for law in seen[:MOST]:
            other = label_of(law.effect) != label_of(delay)
            if other and law.cost < CLEARLY * law.cost_without:
                yield Candidate(delay, law.cost, law.score, law.cost_without), law


def clocks_alone(
    before: Fit,
    located: Localization,
    tried: Sequence[Candidate],
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
) -> list[Candidate]:
    """Give sensors' clocks that explain all alone, where no force does, and sensors are few.

    Where others hear the same motion, a clock is seen without. One that leaves something is
    given where nothing else explains as much: what it hid is looked for beside it.

    Parameters
    ----------
    tried
        Laws with what they explain of the force as it is located, the best first.
    """
    description = before.plant.description
    few = len(description.sensors) <= len(description.dofs)
    if CLOCK not in kinds or not few or located.groups[0].left < LIMITS.several_forces_chi2:
        return []
    (skew,) = kinds[CLOCK].names
    opaque = _opaque(tried)
    beat = max(LIMITS.explained_chi2 * before.data, MOSTLY * before.cost if opaque else 0.0)
    asked = []
    for sensor in description.sensors:
        begin = Effect(CLOCK, Place("sensor", sensor.channel), {skew: SKEWED})
        named = fit_candidate(before, begin, trials, kinds, None, beat, horizons=GRADUALLY)
        if named is not None:
            asked.append(named)
    asked.sort(key=lambda one: one.fit.chi2_in_band)
    all_of_it = [one for one in asked if one.fit.chi2_in_band < LIMITS.explained_chi2]
    most_of_it = asked[:1] if opaque and _outstanding(asked, before) else []
    return [
        Candidate(fitted_effect(one), one.fit.cost, one.score, before.cost)
        for one in all_of_it or most_of_it
    ]


def _opaque(tried: Sequence[Candidate]) -> bool:
    """Whether the best law explains little of the force."""
    return bool(tried) and tried[0].cost >= OPAQUE * tried[0].cost_without


def _outstanding(asked: Sequence[FittedCandidate], before: Fit) -> bool:
    """Whether the best leaves next to nothing of what is missing, and each other far more."""
    if not asked:
        return False
    best, *others = (one.fit.chi2_in_band for one in asked)
    return best < MOSTLY * before.chi2_in_band and all(best < FAR * one for one in others)

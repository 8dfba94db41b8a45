"""Proposer: clocks of sensors that are off, and laws that only a late input hides."""

import dataclasses
from collections.abc import Iterator, Sequence

from slowtime.discrepancy.calibration import Fit, FitControl, attempt
from slowtime.discrepancy.candidates.library_fit import Candidate, label_of, laws_left_by
from slowtime.discrepancy.estimation.candidate_fit import (
    GROWING_HORIZONS,
    FitSchedule,
    fit_candidate,
)
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate, fitted_effect
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, Place

from .protocol import Proposal, Round

LATE, CLOCK = "input_delay", "sensor_clock"
"""Kinds of a late input, and of a sensor whose clock runs fast or slow."""
CLOCK_START = 1e-4
"""[1] Relative error of a clock with which its fit starts. Source: docs/what_decides.md: half
and double change no answer."""
UNEXPLAINED_SHARE = 0.5
"""[share of the chi squared of a force] That the best law leaves, from which no law explains
it. Source: docs/decisions/0030; two hidden pairs had 0.56 and 0.78."""
EXPLAINED_SHARE = 0.2
"""[share of the chi squared of a force] That a law leaves at most, once an input may be late.
Source: the same two hidden pairs had 0.10 and 0.01."""
MAX_CLOCK_REST = 0.01
"""[share of what is missing] That a clock leaves at most beside another effect. Source:
docs/what_decides.md: half and double change no answer; a clock beside a softer spring left
4e-4."""
MAX_CLOCK_RATIO = 0.1
"""[1] Of what the best clock leaves to what each other clock leaves, at most. Source:
docs/what_decides.md: half and double change no answer; a clock beside a softer spring had
3e-3."""
LAWS_PER_INPUT = 2
"""[laws] That are proposed beside the delay of each input. Source: a bound on computing
time."""


@dataclasses.dataclass(frozen=True, slots=True)
class SensorClocks:
    """Proposes sensors whose clock is off, where that alone explains all, and sensors are few.

    Where others hear the same motion, a clock is seen without. One that leaves something is
    given where nothing else explains as much: what it hid is looked for beside it.
    """

    name: str = "sensor clocks"

    def __call__(self, given: Round) -> Proposal:
        """Propose clocks in place of the shortlist."""
        before, kinds = given.before, given.kinds
        description = before.plant.description
        few = len(description.sensors) <= len(description.dofs)
        several = given.localized.groups[0].left >= LIMITS.several_forces_chi2
        if given.number or CLOCK not in kinds or not few or not several:
            return Proposal(self.name, ())
        (skew,) = kinds[CLOCK].names
        opaque = _opaque(given.tried)
        beat = max(
            LIMITS.explained_chi2 * before.data, MAX_CLOCK_REST * before.cost if opaque else 0.0
        )
        fitted = []
        for sensor in description.sensors:
            begin = Effect(CLOCK, Place("sensor", sensor.channel), {skew: CLOCK_START})
            named = fit_candidate(
                before, begin, given.trials, kinds, None,
                control=FitControl(cost_to_beat=beat),
                schedule=FitSchedule(horizons=GROWING_HORIZONS),
            )  # fmt: skip
            if named is not None:
                fitted.append(named)
        fitted.sort(key=lambda one: one.fit.chi2_in_band)
        all_of_it = [one for one in fitted if one.fit.chi2_in_band < LIMITS.explained_chi2]
        most_of_it = fitted[:1] if opaque and stands_out(fitted, before) else []
        clocks = (
            Candidate(fitted_effect(one), one.fit.cost, one.score, before.cost)
            for one in all_of_it or most_of_it
        )
        return Proposal(self.name, tuple(clocks), only=True)


def pairs_with_delayed_input(given: Round) -> Iterator[tuple[Candidate, Candidate]]:
    """Give a delay of an input and a law each, where the law is seen only beside that."""
    # A late input puts every mode out of phase, and what another effect does is hidden by that.
    before, trials, kinds = given.before, given.trials, given.kinds
    if LATE not in kinds or not _opaque(given.tried):
        return
    there = {label_of(effect) for effect in before.plant.effects}
    for entry in before.plant.description.inputs:
        place = Place("input", entry.channel)
        if (LATE, place) in there:
            continue
        if given.monitor.is_late:
            return
        begin = Effect(LATE, place, {kinds[LATE].names[0]: 0.5 / trials[0].rate_hz})
        named = fit_candidate(before, begin, trials, kinds, None)
        if named is None:
            continue
        delay = fitted_effect(named)
        left = attempt(laws_left_by, named.fit, trials, kinds)
        for law in left[2][:LAWS_PER_INPUT] if left is not None else ():
            if law.cost < EXPLAINED_SHARE * law.cost_without and label_of(
                law.effect
            ) != label_of(delay):
                yield Candidate(delay, law.cost, law.score, law.cost_without), law


def _opaque(tried: Sequence[Candidate]) -> bool:
    """Whether the best law explains little of the force."""
    return bool(tried) and tried[0].cost >= UNEXPLAINED_SHARE * tried[0].cost_without


def stands_out(asked: Sequence[FittedCandidate], before: Fit) -> bool:
    """Whether the best leaves next to nothing of what is missing, and each other far more."""
    if not asked:
        return False
    best, *others = (one.fit.chi2_in_band for one in asked)
    return best < MAX_CLOCK_REST * before.chi2_in_band and all(
        best < MAX_CLOCK_RATIO * one for one in others
    )

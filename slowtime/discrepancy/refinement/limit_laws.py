"""Laws at the end of their range, renamed to the simpler law that they become there.

A hidden oscillator much faster than the motion moves with its node: the records show its mass,
and of its frequency only that it lies beyond them. A mass that jumps as the records begin was
different all along. Which of two such laws a search tries first must not decide between their
names.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np

from slowtime.discrepancy.calibration import Fit, try_refit
from slowtime.discrepancy.calibration.augmentation import fitted_effects, states_without
from slowtime.discrepancy.candidates.library_fit import label_of
from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.discrepancy.estimation.candidate_fit import limit_of
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate, evidence, misfit
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.quoting import requote_all
from slowtime.discrepancy.selection.acceptance import MIN_NESTED_GAIN
from slowtime.discrepancy.selection.probabilities import first_doubts
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, Friction, Kind
from slowtime.dynamics.plant import Plant

from .elimination import left_out


def name_limits(hypothesis: Hypothesis, kinds: Mapping[str, Kind]) -> Hypothesis:
    """Put the simpler law in the place of each that does nothing beyond it.

    Its further numbers are then not worth their cost in evidence, or explain less than
    `MIN_NESTED_GAIN` of what was missing without the law.
    """
    whole = hypothesis.last_fits_whole_records and hypothesis.holds is None
    if not whole or hypothesis.final or hypothesis.without_sensor or hypothesis.combined:
        return hypothesis
    for number in range(len(hypothesis.effects)):
        limit = _fit_of_limit(hypothesis, number, kinds)
        if limit is not None and _is_enough(limit, hypothesis, number, kinds):
            hypothesis = _with_limit(hypothesis, number, limit, kinds)
    return hypothesis


def _fit_of_limit(hypothesis: Hypothesis, number: int, kinds: Mapping[str, Kind]) -> Fit | None:
    """Fit the simpler law instead, as strong; None where there is none, or it breaks down."""
    last, at = hypothesis.last, hypothesis.given_effects + number
    effect = fitted_effects(last)[at]
    label = limit_of(effect)
    if label is None or label[0] not in kinds:
        return None
    general, simple = kinds[effect.kind], kinds[label[0]]
    # Fits of friction end in many minima: such laws are compared where they are accepted.
    if isinstance(general.action, Friction):
        return None
    assert general.strength is not None
    assert simple.strength is not None
    strength = effect.parameters[general.strength]
    entry = Effect(simple.name, effect.place, {simple.strength: strength}).entry()
    description = last.plant.description
    effects = tuple(entry if i == at else one for i, one in enumerate(description.effects))
    plant = Plant.of(dataclasses.replace(description, effects=effects), kinds=kinds)
    known = dict(zip(last.plant.parameters, last.values.tolist(), strict=True))
    values = np.array([known.get(name, one.value) for name, one in plant.entries.items()])
    return try_refit(
        plant, hypothesis.trials, noise=last.noise, values=values,
        states=states_without(last, at), horizons=(1.0,),
    )  # fmt: skip


def _is_enough(
    limit: Fit, hypothesis: Hypothesis, number: int, kinds: Mapping[str, Kind]
) -> bool:
    """Whether the simpler law explains as much."""
    last = hypothesis.last
    if evidence(last, kinds) - evidence(limit, kinds) < LIMITS.least_log_evidence:
        return True
    without = hypothesis.fits[number]
    if len(without.states) != len(hypothesis.trials):
        return False
    missing = misfit(without, last.noise, hypothesis.trials) - last.data
    return limit.cost - last.cost < MIN_NESTED_GAIN * missing


def _with_limit(
    hypothesis: Hypothesis, number: int, limit: Fit, kinds: Mapping[str, Kind]
) -> Hypothesis:
    """Name the simpler law, and keep the other as one that would fit as well."""
    last, trials = hypothesis.last, hypothesis.trials
    effects = list(hypothesis.effects)
    effects[number] = _renamed(effects[number], limit, hypothesis.given_effects + number, kinds)
    chain = [hypothesis.first, *left_out(hypothesis.fits, number, limit, trials, kinds)]
    general = FittedCandidate(
        hypothesis.effects[number].effect, last.plant.description, last, evidence(last, kinds)
    )
    return dataclasses.replace(
        hypothesis.with_effects(chain, requote_all(effects, chain[-1], kinds)),
        undecided=first_doubts(effects),
        pair=None,
        nested=(*hypothesis.nested, general),
    )


def _renamed(
    answer: NamedEffect, limit: Fit, at: int, kinds: Mapping[str, Kind]
) -> NamedEffect:
    """Give an answer the name of the simpler law, and its share of the probability."""
    effect = fitted_effects(limit)[at]
    same = [one for one in answer.rivals if (one.effect, one.place) == label_of(effect)]
    return dataclasses.replace(
        answer,
        effect=effect,
        family=kinds[effect.kind].family,
        probability=min(answer.probability + sum(one.probability for one in same), 1.0),
        rivals=tuple(one for one in answer.rivals if one not in same),
    )

"""Removal of effects with which the model explains held-out records worse.

An effect that does not explain the fitted records, and with which the error on held-out records
is larger than that of the model as given, is left out. So is such a refit of constants.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np

from slowtime.discrepancy.calibration.augmentation import carry_effect, described_effects
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.records import Campaign
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.validation.free_run import evaluate_free_run, evaluation_trials
from slowtime.dynamics.effects import Kind, Unmeasured

MAX_ERROR_RATIO = 1.02
"""[1] Of the error of a model to that of the model as given, on what was not fitted. Source:
docs/what_decides.md: half and double change no answer."""


def drop_harmful_effects(hypothesis: Hypothesis, campaign: Campaign) -> Hypothesis:
    """Drop the last effects while they explain neither what was fitted nor what was not.

    Where all that was fitted is explained, a free run may go astray for reasons of its own:
    motion may be chaotic, and a clock unknown. And what moves nothing in the mean, as a base
    that nobody measured, leaves what it leaves; only the constants may be better as given.
    """
    first, last = hypothesis.first, hypothesis.last
    if chi2_p_value(last) > LIMITS.coloured_p_value or len(hypothesis.fits) != 1 + len(
        hypothesis.effects
    ):
        return hypothesis
    own = [v for name, v in zip(last.plant.parameters, last.values, strict=True)
           if name[:2] == ("effect", len(last.plant.effects) - 1)]  # fmt: skip
    kinds = last.plant.kinds
    if hypothesis.effects and not (np.any(own) or _moves_nothing(hypothesis, kinds)):
        return hypothesis
    tests = evaluation_trials(hypothesis.trials, campaign.holdout)
    given = dataclasses.replace(first, values=first.plant.values)
    bar = MAX_ERROR_RATIO * float(
        evaluate_free_run(campaign.description, given, tests).error.mean()
    )
    while chi2_p_value(hypothesis.last) <= LIMITS.coloured_p_value:
        last = hypothesis.last
        if float(evaluate_free_run(last.plant.description, last, tests).error.mean()) <= bar:
            break
        if len(hypothesis.effects) == 1 and _moves_nothing(hypothesis, kinds):
            effect = described_effects(last.plant.description)[-1]
            fits = (given, carry_effect(given, effect, kinds))
            return dataclasses.replace(hypothesis, fits=fits)
        rest = hypothesis.rest or hypothesis.localized
        hypothesis = dataclasses.replace(hypothesis, rest=rest)
        if not hypothesis.effects:
            return dataclasses.replace(hypothesis, fits=(given, *hypothesis.fits[1:]))
        hypothesis = dataclasses.replace(
            hypothesis.with_effects(hypothesis.fits[:-1], hypothesis.effects[:-1]),
            undecided=(),
            pair=None if hypothesis.undecided else hypothesis.pair,
            final=False,
        )
    return hypothesis


def _moves_nothing(hypothesis: Hypothesis, kinds: Mapping[str, Kind]) -> bool:
    """Return whether the last effect is in the model by name only, and moves nothing."""
    action = kinds[hypothesis.effects[-1].effect.kind].action
    return hypothesis.final or isinstance(action, Unmeasured)

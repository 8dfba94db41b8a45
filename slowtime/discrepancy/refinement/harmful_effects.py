"""Models that leave much of what they were fitted to, in; those that at least do no harm, out.

An effect that does not explain the records, and leads further astray on those it never saw than
the model as it was given, is left out; and so is a refit of constants that does the same.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np

from slowtime.discrepancy.calibration.augmentation import carry_effect, described_effects
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.data.screening import screen
from slowtime.discrepancy.records import Campaign
from slowtime.discrepancy.state import Found
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.validation.free_run import evaluate_free_run, evaluation_trials
from slowtime.dynamics.effects import Kind, Unmeasured

WORSE = 1.02
"""Times the error of the model as given that is not much worse."""


def drop_harmful_effects(found: Found, campaign: Campaign) -> None:
    """Leave out what was added last while it explains neither what was fitted nor what was not.

    Where all that was fitted is explained, a free run may go astray for reasons of its own:
    motion may be chaotic, and a clock unknown. And what moves nothing in the mean, as a base
    that nobody measured, leaves what it leaves; only the constants may be better as given.
    """
    first, last = found.fits[0], found.fits[-1]
    if chi2_p_value(last) > LIMITS.coloured_p_value or len(found.fits) != 1 + len(
        found.answers
    ):
        return
    own = [v for name, v in zip(last.plant.parameters, last.values, strict=True)
           if name[:2] == ("effect", len(last.plant.effects) - 1)]  # fmt: skip
    kinds = last.plant.kinds
    if found.answers and not (np.any(own) or _a_word(found, kinds)):
        return
    tests = evaluation_trials(
        found.trials, tuple(screen(trial).trial for trial in campaign.holdout)
    )
    given = dataclasses.replace(first, values=first.plant.values)
    bar = WORSE * float(evaluate_free_run(campaign.description, given, tests).error.mean())
    while chi2_p_value(found.fits[-1]) <= LIMITS.coloured_p_value:
        last = found.fits[-1]
        if float(evaluate_free_run(last.plant.description, last, tests).error.mean()) <= bar:
            return
        if len(found.answers) == 1 and _a_word(found, kinds):
            effect = described_effects(last.plant.description)[-1]
            found.fits = [given, carry_effect(given, effect, kinds)]
            return
        found.left = found.left or found.located
        if not found.answers:
            found.fits[0] = given
            return
        if found.undecided:
            found.undecided, found.pair = (), None
        found.fits.pop()
        found.answers.pop()
        found.ended = False


def _a_word(found: Found, kinds: Mapping[str, Kind]) -> bool:
    """Whether what was found last is in the model as a word only, and leads nowhere."""
    return found.ended or isinstance(kinds[found.answers[-1].effect.kind].action, Unmeasured)

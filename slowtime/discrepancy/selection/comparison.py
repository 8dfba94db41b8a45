"""Comparison of two hypotheses about the same records."""

import dataclasses
import math
from collections.abc import Mapping

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.estimation.model_evidence import (
    FittedCandidate,
    evidence,
    misfit,
    rescored,
)
from slowtime.discrepancy.estimation.shooting_fit import unexplained_by
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Kind

from .probabilities import hardly_any


def explains_all(hypothesis: Hypothesis) -> bool:
    """Return whether a hypothesis leaves nothing that is worth another search."""
    first, last = hypothesis.first, hypothesis.last
    enough = (
        last.chi2_in_band < LIMITS.explained_chi2
        or chi2_p_value(last) > LIMITS.coloured_p_value
    )
    little = bool(hypothesis.effects) and hardly_any(last, first)
    return hypothesis.final or enough or little


def leaves_too_little(hypothesis: Hypothesis) -> bool:
    """Return whether all that is left, noise included, is too little for another effect."""
    # Whatever another effect explained of that, it would be negligible beside what was missing
    # at first.
    first, last, trials = hypothesis.first, hypothesis.last, hypothesis.trials
    if not hypothesis.effects or not hypothesis.fits_whole_records:
        return False
    left, missing = (misfit(fit, last.noise, trials) for fit in (last, first))
    return left < LIMITS.negligible_share * (missing - last.data)


def better(
    one: Hypothesis,
    other: Hypothesis,
    kinds: Mapping[str, Kind],
    least: float = LIMITS.least_log_evidence,
) -> Hypothesis:
    """Give the likelier of two hypotheses, by the noise of the one that leaves least.

    One that suggests another hold of the inputs is followed, because it explains all under it.
    The second has to bring `least` log evidence [nats]; it is given with its probability.
    """
    if other.suggested_holds is not None:
        return other
    if other.without_sensor or one.without_sensor:
        return one  # a sensor that is left out leaves nothing to compare
    if len(one.trials) != len(other.trials):
        # One of them is judged by segments of records: nothing less would have explained them.
        return other if explains_all(other) else one
    if not other.effects:
        return one
    fits = one.last, other.last
    quietest = min(fits, key=unexplained_by)
    scores = [
        evidence(fit, kinds)
        if fit is quietest
        else rescored(
            FittedCandidate(other.effects[-1].effect, fit.plant.description, fit, 0.0),
            quietest,
            one.trials,
            kinds,
        ).score
        for fit in fits
    ]
    lead = scores[1] - scores[0]
    more = len(other.effects) > len(one.effects)
    if lead < least or (more and _negligible_gain(one, *fits, quietest)):
        return one
    tempered = LIMITS.evidence_power * lead / max(quietest.chi2_in_band, 1.0)
    share = 1 / (1 + math.exp(-min(tempered, 50.0)))
    head, *rest = other.effects
    head = dataclasses.replace(head, probability=share * head.probability)
    return dataclasses.replace(other, effects=(head, *rest), fitted=one.fitted, tried=one.tried)


def _negligible_gain(hypothesis: Hypothesis, fewer: Fit, more: Fit, quietest: Fit) -> bool:
    """Return whether more effects explain next to nothing of what was missing at first."""
    bare, with_fewer, with_more = (
        misfit(fit, quietest.noise, hypothesis.trials)
        for fit in (hypothesis.first, fewer, more)
    )
    return with_fewer - with_more < LIMITS.negligible_share * (bare - quietest.data)

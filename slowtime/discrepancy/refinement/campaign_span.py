"""Extrapolation of drifts from the fitted records to the whole campaign."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.quoting import requoted
from slowtime.discrepancy.records import Campaign
from slowtime.dynamics.effects import Kind

SPAN = "span_s"


def span_campaign(
    hypothesis: Hypothesis, own: int, campaign: Campaign, kinds: Mapping[str, Kind]
) -> Hypothesis:
    """Quote drifts by what they come to at the end of all records, held-out ones included."""
    every = (*campaign.trials, *campaign.holdout)
    end = max(trial.start_s + trial.duration_s for trial in every)
    fits = [spanning(fit, own, end) for fit in hypothesis.fits]
    effects = [
        requoted(named, fits[-1], own + number, kinds)
        if SPAN in named.effect.parameters and SPAN in kinds[named.effect.kind].names
        else named
        for number, named in enumerate(hypothesis.effects)
    ]
    return hypothesis.with_effects(fits, effects)


def spanning(fit: Fit, own: int, end_s: float) -> Fit:
    """Express drifts of a fit over another span: the same slope, another change at the end.

    Values, priors and covariance are rescaled to the span `end_s` [s], but for the effects
    (`own`) that the model had as it was given.
    """
    values, factors = fit.values.copy(), np.ones(len(fit.prior.names))
    for number, effect in enumerate(fit.plant.effects):
        names = fit.plant.kinds[effect.kind].names
        if number < own or SPAN not in names or SPAN not in effect.parameters:
            continue
        at = fit.plant.parameters.index(("effect", number, SPAN))
        longer = end_s / values[at]
        if not np.isfinite(longer):
            continue
        values[at] = end_s
        for i, name in enumerate(fit.prior.names):
            if name[:2] == ("effect", number):
                factors[i] *= longer
                values[fit.prior.index[i]] *= longer
    prior = dataclasses.replace(
        fit.prior,
        mean=fit.prior.mean * factors,
        sd=fit.prior.sd * factors,
        scale=fit.prior.scale * factors,
    )
    covariance = fit.covariance * np.outer(factors, factors)
    return dataclasses.replace(fit, values=values, prior=prior, covariance=covariance)

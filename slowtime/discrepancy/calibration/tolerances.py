"""Refit of a wrong model with its constants held to their tolerances."""

import numpy as np

from slowtime.discrepancy.records import Trial
from slowtime.dynamics.plant import Plant

from .fit import Fit, try_refit
from .levenberg_marquardt import WRONG_MODEL_CHI2, FitControl

LEFT_TOLERANCES = 5.0
"""[tolerances] From which a constant counts as bent to make up for what is missing. Source:
five sigma; no constant claimed in good faith is off by as much (docs/decisions/0017)."""
HELD_TOLERANCES = 3.0
"""[tolerances] To which constants are then held. Source: docs/decisions/0017; three-sigma
rule."""


def refit_within_tolerances(fit: Fit, trials: tuple[Trial, ...]) -> Fit:
    """Refit within tolerances where constants make up for what is missing."""
    # Chi squared of a wrong model outweighs every prior, and moves constants so far that
    # nothing can be linearised about them. What is missing is then located from the claimed
    # constants.
    most = max(map(abs, fit.constant_pulls.values()), default=0.0)
    if fit.chi2_in_band < WRONG_MODEL_CHI2 or most <= LEFT_TOLERANCES:
        return fit
    values = fit.values.copy()
    for name, index, mean in zip(fit.prior.names, fit.prior.index, fit.prior.mean, strict=True):
        if name[0] != "effect":
            values[index] = mean
    held = try_refit(
        fit.plant, trials, noise=fit.noise, values=values,
        states=tuple(np.zeros_like(state) for state in fit.states), horizons=(1.0,),
        control=FitControl(max_tolerances=HELD_TOLERANCES),
    )  # fmt: skip
    return held or fit


def fit_within_tolerances(plant: Plant, trials: tuple[Trial, ...]) -> Fit | None:
    """Fit a model with its constants within tolerances; None where the fit breaks down."""
    return try_refit(plant, trials, control=FitControl(max_tolerances=HELD_TOLERANCES))

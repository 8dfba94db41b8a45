"""Refit of constants that are stuck in a local minimum, from other values.

Of constants that are far off, a refit may settle in a minimum that is not the lowest: the
frequencies of a lightly damped structure are many half-power bandwidths off, and a free run
that is out of step has no slope towards them. All stiffnesses are then tried larger and smaller
by one factor. A law that is fitted beside the constants begins elsewhere, too, and gets past
such a minimum; it would then be named for what was none of its own.
"""

from collections.abc import Sequence

import numpy as np

from slowtime.discrepancy.calibration import Fit, try_refit
from slowtime.discrepancy.calibration.augmentation import described_effects
from slowtime.discrepancy.calibration.fit import referred_to
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.calibration.tolerances import LEFT_TOLERANCES
from slowtime.discrepancy.candidates.constant_equivalents import CONSTANTS
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate, misfit
from slowtime.discrepancy.quoting import moved_of
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.workers import map_shared
from slowtime.dynamics.effects import Effect
from slowtime.dynamics.plant import Name
from slowtime.dynamics.work import unmetered

LOWER_MINIMUM_SHARE = 0.5
"""[share of what a refit left] Below which there is a lower minimum. Source:
docs/decisions/0026."""


MAX_LEFT = 0.1
"""[share of the variance] Up to which a refit is not out of step. Source: a free run in step
leaves a third of the amplitude at most; half and double change no answer of
docs/what_decides.md."""
FACTOR_SDS = (-0.5, 0.5, -1.0, 1.0, -1.5, 1.5)
"""[tolerances of stiffness] By which all stiffnesses are changed to begin again. Source: a
third of the width of the prior, both ways; half and double change no answer of
docs/what_decides.md."""
MUCH_LOWER_SHARE = 0.25
"""[share of chi squared] Of a refit begun elsewhere to the first one, below which that was out
of step. Source: of a model that lacks a law, minima differ by less."""


def refit_from_other_stiffnesses(fit: Fit, trials: Sequence[Trial]) -> Fit:
    """Refit from other stiffnesses where the free run is out of step with the records.

    These few refits do not take from the budget of work of the search. The given fit stands
    unless the lowest minimum within the tolerances is much lower.
    """
    own = [
        i for i, name in enumerate(fit.prior.names)
        if name[0] == "stiffness" and fit.prior.mean[i] > 0 and np.isfinite(fit.prior.sd[i])
    ]  # fmt: skip
    left = sum(float(np.var(residual, axis=0).sum()) for residual in fit.residual)
    moved = sum(float(np.var(trial.measured, axis=0).sum()) for trial in trials)
    if not own or left <= MAX_LEFT * moved or fit.chi2_in_band <= LIMITS.far_off_chi2:
        return fit
    at = [fit.prior.index[i] for i in own]
    tolerance = float(np.mean(fit.prior.sd[own] / fit.prior.mean[own]))

    def from_stiffness(sds: float) -> Fit | None:
        values = fit.plant.values.copy()
        values[at] *= np.exp(sds * tolerance)
        with unmetered():
            return try_refit(fit.plant, trials, values=values, noise=fit.noise)

    best = fit
    for other in map_shared(from_stiffness, FACTOR_SDS, referred_to(fit, trials)):
        if other is None or max(map(abs, other.constant_pulls.values())) > LEFT_TOLERANCES:
            continue
        if other.cost < MUCH_LOWER_SHARE * best.cost:
            best = other
    if best is fit:
        return fit
    with unmetered():
        again = try_refit(
            fit.plant, trials, values=best.values, states=best.states, horizons=(1.0,)
        )
    return again or best


def release_constants(
    bent: Fit, named: Sequence[FittedCandidate], trials: Sequence[Trial]
) -> Fit | None:
    """Refit a model without any law from where the best law led its constants, if it gains.

    The fit `bent` started from the constants as claimed.
    """
    best = named[0].fit if named else None
    if best is None or best.chi2_in_band > LOWER_MINIMUM_SHARE * bent.chi2_in_band:
        return None
    values = dict(zip(best.plant.parameters, best.values.tolist(), strict=True))
    (law,) = described_effects(with_values(named[0].description, values))[-1:]
    if not moved_of(best) and law.kind not in CONSTANTS:
        return None
    _take_over(values, law)
    names = best.plant.state_names
    states = [dict(zip(names, state.tolist(), strict=True)) for state in best.states]
    left = misfit(bent, bent.noise, trials)
    again = try_refit(
        bent.plant,
        trials,
        values=np.array([values[name] for name in bent.plant.parameters]),
        states=[np.array([s[n] for n in bent.plant.state_names]) for s in states],
        horizons=(1.0,),
    )
    if again is None or misfit(again, bent.noise, trials) >= LOWER_MINIMUM_SHARE * left:
        return None
    return again


def _take_over(values: dict[Name, float], law: Effect) -> None:
    """Let a constant do what a change of it did."""
    what, sign = CONSTANTS.get(law.kind, ("", 0.0))
    name = (what, law.place.id)
    if name in values:
        (change,) = law.parameters.values()
        values[name] += sign * change

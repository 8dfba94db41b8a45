"""Refit of constants that are stuck in a local minimum, from where a law has led them.

Of constants that are far off, a refit may settle in a minimum that is not the lowest. A law
that is fitted beside them begins elsewhere, and gets past it; it would then be named for what
was none of its own.
"""

from collections.abc import Sequence

import numpy as np

from slowtime.discrepancy.calibration import Fit, try_refit
from slowtime.discrepancy.calibration.augmentation import described_effects
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.candidates.constant_equivalents import CONSTANTS
from slowtime.discrepancy.estimation.candidate_fit import FittedCandidate, misfit
from slowtime.discrepancy.quoting import moved_of
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.effects import Effect
from slowtime.dynamics.plant import Name

LOWER_MINIMUM_SHARE = 0.5
"""[share of what a refit left] Below which there is a lower minimum. Source:
docs/decisions/0026."""


def release_constants(
    bent: Fit, named: Sequence[FittedCandidate], trials: Sequence[Trial]
) -> Fit | None:
    """Refit a model without any law from where the best law has led its constants.

    Parameters
    ----------
    bent
        Refitted from where it was claimed to be.
    named
        The same with one law more, the best first.

    Returns
    -------
    None where that comes to nothing better.
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

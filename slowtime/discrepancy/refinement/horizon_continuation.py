"""Several effects that leave much, in; the same, fitted to ever longer records again, out.

Each was fitted while others were missing, to whole records, and made up for them. Beside the
others, and over how records begin, it finds back to what it is.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import (
    WRONG_MODEL_CHI2,
    FitAbandoned,
    first_periods,
    refit,
)
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.calibration.initial_states import refit_initial_states
from slowtime.discrepancy.estimation.candidate_fit import GRADUALLY, SLOWLY
from slowtime.discrepancy.estimation.shooting_fit import unexplained_by
from slowtime.discrepancy.selection.probabilities import hardly_any
from slowtime.discrepancy.state import Found
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Friction, Kind


def refit_with_growing_horizon(found: Found, kinds: Mapping[str, Kind]) -> None:
    """Fit the last model anew where it leaves more than a right one; keep what leaves less."""
    if found.fits[-1].chi2_in_band >= WRONG_MODEL_CHI2:
        _regrow(found, kinds, GRADUALLY)


def refit_friction_with_growing_horizon(found: Found, kinds: Mapping[str, Kind]) -> None:
    """Fit friction that was found alone anew; keep what leaves less.

    It sticks at an instant or does not, and its misfit has a minimum for either.
    """
    last = found.fits[-1]
    one = found.answers[0].effect if len(found.answers) == 1 else None
    if one is None or not isinstance(kinds[one.kind].action, Friction):
        return
    little = last.chi2_in_band < LIMITS.far_off_chi2 and not hardly_any(last, found.fits[0])
    if little and chi2_p_value(last) < LIMITS.coloured_p_value:
        _regrow(found, kinds, SLOWLY)


def _regrow(found: Found, kinds: Mapping[str, Kind], horizons: Sequence[float]) -> None:
    last, trials = found.fits[-1], found.trials
    if len(last.states) != len(trials) or found.holds is not None or found.ended:
        return
    try:
        start = refit_initial_states(last, first_periods(last.plant, trials))
        again = refit(
            last.plant, trials, values=last.values, states=start.states, horizons=horizons
        )
    except (np.linalg.LinAlgError, FloatingPointError, FitAbandoned):
        return
    if unexplained_by(again) < unexplained_by(last):
        found.put_last(again, kinds)

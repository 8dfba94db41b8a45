"""Refit of several effects to growing parts of the records (horizon continuation).

Each was fitted while others were missing, to whole records, and made up for them. Beside the
others, and over how records begin, it finds back to what it is.
"""

from collections.abc import Mapping, Sequence

from slowtime.discrepancy.calibration import (
    WRONG_MODEL_CHI2,
    attempt,
    first_periods,
    try_refit,
)
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.calibration.initial_states import refit_initial_states
from slowtime.discrepancy.estimation.candidate_fit import GROWING_HORIZONS, STICK_SLIP_HORIZONS
from slowtime.discrepancy.estimation.shooting_fit import unexplained_by
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.selection.probabilities import hardly_any
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Friction, Kind


def refit_with_growing_horizon(hypothesis: Hypothesis, kinds: Mapping[str, Kind]) -> Hypothesis:
    """Fit the last model again to ever longer parts, where it leaves more than a right one."""
    if hypothesis.last.chi2_in_band < WRONG_MODEL_CHI2:
        return hypothesis
    return _continued(hypothesis, kinds, GROWING_HORIZONS)


def refit_friction_with_growing_horizon(
    hypothesis: Hypothesis, kinds: Mapping[str, Kind]
) -> Hypothesis:
    """Fit friction that was found alone again to ever longer parts."""
    last = hypothesis.last
    one = hypothesis.effects[0].effect if len(hypothesis.effects) == 1 else None
    if one is None or not isinstance(kinds[one.kind].action, Friction):
        return hypothesis
    # Friction sticks at an instant or does not, and its misfit has a minimum for either.
    little = last.chi2_in_band < LIMITS.far_off_chi2 and not hardly_any(last, hypothesis.first)
    if little and chi2_p_value(last) < LIMITS.coloured_p_value:
        return _continued(hypothesis, kinds, STICK_SLIP_HORIZONS)
    return hypothesis


def _continued(
    hypothesis: Hypothesis, kinds: Mapping[str, Kind], horizons: Sequence[float]
) -> Hypothesis:
    last, trials = hypothesis.last, hypothesis.trials
    whole = hypothesis.last_fits_whole_records and hypothesis.holds is None
    if not whole or hypothesis.final:
        return hypothesis
    start = attempt(refit_initial_states, last, first_periods(last.plant, trials))
    if start is None:
        return hypothesis
    again = try_refit(
        last.plant, trials, values=last.values, states=start.states, horizons=horizons
    )
    if again is None or unexplained_by(again) >= unexplained_by(last):
        return hypothesis
    return hypothesis.with_last(again, kinds)

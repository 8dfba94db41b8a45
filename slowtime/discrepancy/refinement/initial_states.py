"""Refit of initial states, where only the beginning of records is not explained.

What is thrown into a strong law moves, at first, unlike what it does later; and what sings
forgets how it began. The constants are known by then from all that follows: only the state has
to be looked for, over the first swings.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.calibration import (
    WRONG_MODEL_CHI2,
    Fit,
    first_periods,
    motion_amplitude,
    multistart_initial_state,
    try_refit,
)
from slowtime.discrepancy.estimation.shooting_fit import unexplained_by
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.effects import Kind

MAX_BEGINNING_RATIO = 4.0
"""[1] Of the mean square of the residual at the beginning of a record to that later, above
which the initial state is wrong. Source: docs/what_decides.md: half and double change no
answer."""

State = Float[np.ndarray, " state"]


def restart_initial_states(hypothesis: Hypothesis, kinds: Mapping[str, Kind]) -> Hypothesis:
    """Fit the last model from other initial states, where that leaves less."""
    if not hypothesis.last_fits_whole_records or hypothesis.holds is not None:
        return hypothesis
    again = restarted(hypothesis.last, hypothesis.trials)
    return hypothesis if again is None else hypothesis.with_last(again, kinds)


def restarted(fit: Fit, trials: Sequence[Trial]) -> Fit | None:
    """Give the fit with other initial states, where that leaves less; else nothing."""
    if fit.chi2_in_band < WRONG_MODEL_CHI2:
        return None
    heads = first_periods(fit.plant, trials)
    states = [
        _elsewhere(fit, trials[number], heads[number], number)
        if _begins_badly(fit, number, heads[number])
        else fit.states[number]
        for number in range(len(trials))
    ]
    if all(one is known for one, known in zip(states, fit.states, strict=True)):
        return None
    again = try_refit(fit.plant, trials, values=fit.values, states=states, horizons=(1.0,))
    if again is None or unexplained_by(again) >= unexplained_by(fit):
        return None
    return again


def _begins_badly(fit: Fit, number: int, head: Trial) -> bool:
    left, first = fit.residual[number], len(head.outputs)
    if len(left) < 2 * first:
        return False
    early, late = np.mean(left[:first] ** 2, axis=0), np.mean(left[first:] ** 2, axis=0)
    return float(early.sum()) > MAX_BEGINNING_RATIO * float(late.sum())


def _elsewhere(fit: Fit, trial: Trial, head: Trial, number: int) -> State:
    """Give the initial state from which the first swings are explained best."""
    known = fit.states[number]
    size = motion_amplitude(fit.plant, trial, fit.values, known)
    return multistart_initial_state(
        fit.plant, head, fit.noise.for_trials([number]), fit.values, known, size
    )

"""Refinement of the instant at which a law switches."""

import functools
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import Fit, FitControl, attempt, refit
from slowtime.discrepancy.calibration.augmentation import simulated_chi2
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Kind, Law

SCAN_HALF_WIDTH_S = 2.4
"""[s] Around an instant, within which a better one is sought closely. Source:
docs/what_decides.md: half and double change no answer."""
CLOSE_STEP_S = SCAN_HALF_WIDTH_S / 30
"""[s] Between instants that are tried closely."""
SCAN_CHI2 = 1.5
"""[noise variances] Mean square in band from which whole records are scanned first. Source:
docs/decisions/0026 for the rule; docs/what_decides.md for the value: half and double change no
answer."""
SCAN_STEP_S = 1.2
"""[s] Between instants of the scan of whole records. Source: half of `SCAN_HALF_WIDTH_S`, so
that closer scans around neighbours overlap."""
MAX_COST_RATIO = 4.0
"""[1] Times the cost of another law up to which the instant of a law is sought in whole
records. Source: docs/what_decides.md: half and double change no answer."""
MAX_MOVES = 4
"""[refits] From a better instant at most, because a law that was fitted to a wrong instant
hides the right one. Source: docs/decisions/0030 for the rule; docs/what_decides.md for the
value: half and double change no answer."""


def refine_switching_instant(
    fit: Fit,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    beat: float | None,
    most: float,
    which: int | None = None,
    late: Callable[[], bool] | None = None,
) -> Fit:
    """Refit a law that switches once from a better instant of its switch, while there is one.

    The misfit has a minimum for every period by which the instant may be wrong. Where the fit
    leaves less than `most` [noise variances], the instant is sought in whole records, unless
    the fit costs several times as much as another model (`beat`). `which` is the number of the
    effect, the last where not given.
    """
    which = len(fit.plant.effects) - 1 if which is None else which
    action = kinds[fit.plant.effects[which].kind].action
    if not isinstance(action, Law) or len(action.switches) != 1:
        return fit
    at = fit.plant.parameters.index(("effect", which, action.switches[0]))
    for _ in range(MAX_MOVES):
        if chi2_p_value(fit) > LIMITS.white_p_value or (late is not None and late()):
            break
        better = _moved(fit, trials, at, beat, most, late)
        if better is fit:
            break
        fit = better
    return fit


def _moved(
    fit: Fit,
    trials: Sequence[Trial],
    at: int,
    beat: float | None,
    most: float,
    late: Callable[[], bool] | None,
) -> Fit:
    """Refit from the best instant there is; the fit itself where none is better."""
    ends = [(t.start_s, t.start_s + t.duration_s) for t in trials]

    @functools.cache
    def left(number: int, instant: float) -> float:
        values = fit.values.copy()
        values[at] = instant
        return simulated_chi2(fit.plant, values, fit.states, fit.noise, trials, [number])

    def misfit(instant: float) -> float:
        # Before or after a record it is the same whenever that was.
        return sum(left(i, min(max(instant, a), b)) for i, (a, b) in enumerate(ends))

    about = [float(fit.values[at])]
    hopeless = beat is not None and fit.cost > MAX_COST_RATIO * beat
    if SCAN_CHI2 < fit.chi2_in_band < most and not hopeless:
        # Of each record the best, for about the right one the misfit falls in no time.
        about += [float(min(np.arange(a, b, SCAN_STEP_S), key=misfit)) for a, b in ends]
    # On one grid, so that scans around neighbours share what was simulated.
    firsts = [round((one - SCAN_HALF_WIDTH_S) / CLOSE_STEP_S) for one in about]
    tried = {n * CLOSE_STEP_S for first in firsts for n in range(first, first + 61)}
    best = float(min([about[0], *sorted(tried)], key=misfit))
    if abs(best - fit.values[at]) < CLOSE_STEP_S / 2:
        return fit
    values = fit.values.copy()
    values[at] = best
    again = attempt(
        refit, fit.plant, trials, noise=fit.noise, values=values, states=fit.states,
        horizons=(1.0,), control=FitControl(cost_to_beat=beat, is_late=late),
    )  # fmt: skip
    return again if again is not None and again.cost < fit.cost else fit

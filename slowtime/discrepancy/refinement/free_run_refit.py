r"""Refit of the final model to the plain error of its free runs, kept if cross-validated.

A model that leaves noise only is fitted best by residuals weighted with that noise. A model
that leaves more, or whose runs drift by errors of the measured force, is not: lines at which
the weights are large decide, and these are seldom those at which a free run goes astray. Such
a model is refitted with white weights, the same over all of each record,

.. math:: \sum_{t s} r_{ts}^2 / (\rho_s \sigma_s) ,

with :math:`\rho_s` the root mean square of the residual of sensor s before and
:math:`\sigma_s` the standard deviation of what it measured: the gradient is that of the sum of
:math:`\rho_s / \sigma_s`, the error that models are judged by. The refit is kept only if pieces
of the records to which it was not fitted are predicted better by more than their scatter.

White weights tell less of most constants: what goes astray is slow. So the refit is the model
that is simulated, but the number of a constant is quoted from it only if refits without one
piece (delete-a-group jackknife) agree that it is another than before. Where their scatter
covers the estimate by weighted residuals, that one stands, because it is determined better.

References
----------
.. [1] M. Stone, "Cross-validatory choice and assessment of statistical predictions", J. R.
   Stat. Soc. B 36 (1974).
.. [2] R. G. Miller, "The jackknife: a review", Biometrika 61 (1974).
"""

import dataclasses
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from jaxtyping import Bool
from scipy.special import stdtrit

from slowtime.discrepancy.calibration import WRONG_MODEL_CHI2, Fit, FitControl, try_refit
from slowtime.discrepancy.noise import Colour, Noise
from slowtime.discrepancy.records import MIN_SAMPLES, Trial
from slowtime.discrepancy.time_limit import budget_share, leave_out
from slowtime.discrepancy.validation.free_run import free_runs, heads_of, relative_errors
from slowtime.dynamics.work import metered

PIECES = 4
"""[1] Of each record, left out in turn. Source: a piece then begins with an initial state of
its own and is long enough to go astray, and three quarters are fitted; half and double change
no answer of docs/what_decides.md."""
MIN_GAIN_SDS = 2.0
"""[standard errors] By which the mean log ratio of errors on pieces left out must be above
zero. Source: two-sigma rule, one-sided p-value of 2 %."""
MIN_LOG_GAIN = 0.05
"""[1] By which it must be above zero at least. Source: 5 % of the error are not worth constants
that explain the records less well."""
MAX_RATIO = 2.0
"""[1] Of a constant after the refit to the one before, either way, up to which both are the
same constant. Source: docs/what_decides.md: half and double change no answer."""
MOVED_P_VALUE = 0.05
"""[probability] Of as large a change of a constant by the scatter of refits without one piece,
below which another number is quoted. Source: the 5 % level."""
SIGNIFICANT_SDS = 3.0
"""[standard deviations] From zero, from which a constant is asked whether it changed as much.
Source: three-sigma rule."""


MAX_WORK = 4e9
"""[units of work] Of the refit. Source: a decision; a drive of one coordinate and 25,000
samples takes two thirds of it, in six seconds of processor time."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FreeRunRefit:
    """A refit to the plain error of free runs, and what it gains on pieces left out.

    Parameters
    ----------
    fit
        The given one with other constants, initial states, outputs and residuals. Half the
        square of the change is added to the covariance, as two weights told different values.
    estimate
        The given one with other constants where pieces of the records contradict it; these are
        the numbers to quote.
    gain
        Mean logarithm of the ratio of errors on pieces left out, before over after [1].
    """

    fit: Fit
    estimate: Fit
    gain: float


def refit_to_free_runs(
    fit: Fit, trials: Sequence[Trial], tell: Callable[[], None] | None = None
) -> FreeRunRefit | None:
    """Refit the constants to the plain error of free runs, where that predicts better.

    It is given up after `MAX_WORK`, or its share of that in a shorter diagnosis, and works
    though the budget of the search is used up: its fits begin close to where they end. None
    where the model leaves noise only, records are too short to be cut into pieces, constants
    would be others than before, or pieces left out are not predicted better by more than their
    scatter.
    """
    if not _is_worth_it(fit, trials):
        return None
    with metered() as meter:

        def is_late() -> bool:
            if tell is not None:
                tell()
            over = meter.spent > budget_share() * MAX_WORK
            return over or leave_out("the refit to free runs")

        again = refit_plainly(fit, trials, trials, is_late)
        if again is None or not are_constants_alike(fit, again):
            return None
        # Refits without a piece begin where the one with all of them ended.
        begin = dataclasses.replace(fit, values=again.values, states=again.states)
        cut = [_leave_out(trials, number) for number in range(PIECES)]
        others = []
        for kept, _ in cut:
            other = refit_plainly(begin, kept, trials, is_late)
            if other is None:
                return None
            others.append(other)
        gain = _validated_gain(fit, others, [pieces for _, pieces in cut])
    if gain is None:
        return None
    moves = contradicted_constants(fit, again, others)
    return FreeRunRefit(_with_runs_of(fit, again), estimate_of(fit, again, moves), gain)


def contradicted_constants(
    fit: Fit, again: Fit, others: Sequence[Fit]
) -> Bool[np.ndarray, " free"]:
    """Whether refits without one piece agree that a constant is another."""
    free = np.array([other.free for other in others])
    count = len(others)
    sd = np.sqrt((count - 1) / count * np.sum((free - free.mean(axis=0)) ** 2, axis=0))
    far = stdtrit(count - 1, 1 - MOVED_P_VALUE / 2)
    return np.asarray(np.abs(again.free - fit.free) > far * sd)


def estimate_of(fit: Fit, again: Fit, moves: Bool[np.ndarray, " free"]) -> Fit:
    """Take constants that move from another fit, and widen their covariance by the change."""
    off = np.where(moves, again.free - fit.free, 0.0)
    values = fit.values.copy()
    values[list(fit.prior.index)] += off
    wide = max(fit.chi2_in_band, 1.0)  # by which `Fit.inflated_sd` inflates it
    covariance = fit.covariance + np.outer(off, off) / (2 * wide)
    return dataclasses.replace(fit, values=values, covariance=covariance)


def _validated_gain(
    fit: Fit, told: Sequence[Fit], pieces: Sequence[Sequence[Trial]]
) -> float | None:
    """Mean log ratio of errors on pieces left out; None where it is within their scatter."""
    ratios = [
        ratio
        for other, left in zip(told, pieces, strict=True)
        for ratio in _log_ratios(fit, dataclasses.replace(fit, values=other.values), left)
    ]
    if len(ratios) < 2:
        return None
    gain = float(np.mean(ratios))
    error = float(np.std(ratios, ddof=1) / np.sqrt(len(ratios)))
    return gain if gain > max(MIN_LOG_GAIN, MIN_GAIN_SDS * error) else None


def refit_plainly(
    fit: Fit,
    trials: Sequence[Trial],
    records: Sequence[Trial],
    is_late: Callable[[], bool] | None = None,
) -> Fit | None:
    """Refit with white weights, the same over each record; None where that breaks down."""
    return try_refit(
        fit.plant, trials,
        free=list(fit.prior.names),
        noise=plain_weights(fit, records), values=fit.values, states=fit.states,
        horizons=(1.0,), control=FitControl(to_convergence=True, is_late=is_late),
    )  # fmt: skip


def refit_plainly_on_heads(fit: Fit, trials: Sequence[Trial]) -> Fit:
    """Refit in the same way to all but the tails of records; the given fit where that fails."""
    heads = heads_of(trials)
    return (refit_plainly(fit, heads, trials) if heads else None) or fit


def plain_weights(fit: Fit, records: Sequence[Trial]) -> Noise:
    """Give the white noise, the same in every record, that weighs errors as they are judged."""
    sizes = []
    for sensor in range(records[0].outputs.shape[1]):
        told = np.concatenate([t.outputs[t.used[:, sensor], sensor] for t in records])
        left = np.concatenate(
            [r[t.used[:, sensor], sensor] for r, t in zip(fit.residual, records, strict=True)]
        )
        sizes.append((np.sqrt(np.mean(left**2)) if left.size else 0.0, np.std(told)))
    rms, scatter = np.array(sizes).T
    known = (rms > 0) & (scatter > 0)
    share = float(np.mean(rms[known] / scatter[known]))
    variance = np.where(known, rms * scatter * share, 1.0)
    colours = tuple(
        tuple(Colour(white=float(2 * one / trial.rate_hz)) for one in variance)
        for trial in records
    )
    return dataclasses.replace(fit.noise, colours=colours, drift=None)


def are_constants_alike(before: Fit, after: Fit) -> bool:
    """Whether every constant that was significant kept its sign and its order of magnitude."""
    for value, sd, other in zip(before.free, before.inflated_sd, after.free, strict=True):
        if abs(value) <= SIGNIFICANT_SDS * sd:
            continue
        if not 1 / MAX_RATIO < other / value < MAX_RATIO:
            return False
    return True


def _with_runs_of(fit: Fit, other: Fit) -> Fit:
    """Take constants and runs from another fit, and widen the covariance by the change."""
    widened = estimate_of(fit, other, np.ones(len(fit.prior.names), dtype=bool))
    return dataclasses.replace(
        widened, values=other.values, states=other.states, outputs=other.outputs,
        residual=other.residual,
    )  # fmt: skip


def _is_worth_it(fit: Fit, trials: Sequence[Trial]) -> bool:
    """Whether the weights of the fit are not those of the noise alone, and pieces suffice."""
    wrong = fit.noise.drift is not None or fit.chi2_in_band > WRONG_MODEL_CHI2
    whole = len(fit.states) == len(trials) and len(fit.residual) == len(trials)
    long = all(len(trial.outputs) >= 2 * PIECES * MIN_SAMPLES for trial in trials)
    left = any(bool(np.any(residual)) for residual in fit.residual)
    return wrong and whole and long and left and bool(fit.prior.names)


def _leave_out(trials: Sequence[Trial], number: int) -> tuple[list[Trial], list[Trial]]:
    """Mask one piece of each record; give the masked records and the pieces."""
    kept, pieces = [], []
    for trial in trials:
        first, last = (len(trial.outputs) * at // PIECES for at in (number, number + 1))
        use = trial.used.copy()
        use[first:last] = False
        kept.append(dataclasses.replace(trial, use=use))
        pieces.append(trial.part(first, last))
    return kept, pieces


def _log_ratios(before: Fit, after: Fit, pieces: Sequence[Trial]) -> Iterator[float]:
    """Logarithms of the ratio of errors on each piece; what did not move is left out."""
    for piece in pieces:
        errors = [_error(fit, piece) for fit in (before, after)]
        if min(errors) > 0:
            yield float(np.log(errors[0] / errors[1]))


def _error(fit: Fit, piece: Trial) -> float:
    return float(np.mean(relative_errors([piece], free_runs(fit, [piece]))))

"""Fit of the final hypothesis to convergence: its parameters are those of the minimum.

While laws are compared, a fit stops where little is gained, to save time. Two parameters that
the records determine only together, such as the damping of a law and that of its element, may
then be a standard deviation off. The misfit of stick-slip motion also has many local minima,
one for each instant at which it may stick. The spread of the parameters over minima that are
as deep as the noise allows is part of their uncertainty.
"""

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import (
    WRONG_MODEL_CHI2,
    Fit,
    FitControl,
    attempt,
    refit,
    try_refit,
)
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.effects import Friction, Kind, Unmeasured

HELD_SDS = (-4.0, -2.0, -1.0, 1.0, 2.0, 4.0)
"""[standard deviations] From the estimate of a friction, at which it is held while all else is
fitted. Source: docs/decisions/0030 for the rule; docs/what_decides.md: half and double change
no answer."""
MAX_ROUNDS = 2
"""[rounds] Of holding it at most: once more around a better estimate. Source: a bound on
computing time."""


def converge(hypothesis: Hypothesis, own: int, kinds: Mapping[str, Kind]) -> Hypothesis:
    """Fit the last model until nothing is gained any more, and read its parameters anew."""
    last = hypothesis.last
    if not _is_explained(hypothesis, kinds):
        return hypothesis
    fit = try_refit(
        last.plant, hypothesis.trials, noise=last.noise, values=last.values,
        states=last.states, horizons=(1.0,), control=FitControl(to_convergence=True),
    )  # fmt: skip
    return hypothesis if fit is None else _with_last(hypothesis, fit, own, kinds)


def converge_stick_slip(
    hypothesis: Hypothesis, own: int, kinds: Mapping[str, Kind], tell: Monitor
) -> Hypothesis:
    """Hold friction beside where its fit ended; take the best, and how far as good ones are.

    All else is fitted at each value. What is not known is what Laplace's approximation leaves
    at the best, how those values scatter, each as likely as its chi squared says, and half the
    square of how far the fit had ended from there.
    """
    last, trials = hypothesis.last, hypothesis.trials
    lead = _friction(last, kinds)
    known = _is_explained(hypothesis, kinds) and np.isfinite(last.sd).all()
    if lead is None or not known:
        return hypothesis

    def late() -> bool:
        tell("looking beside where friction ended", 0.9)
        return tell.is_late

    best, ends = _ends_beside(last, lead, trials, late)
    off = np.array([end.values - best.values for end in ends])[:, list(best.prior.index)]
    share = np.exp(np.minimum([best.cost - end.cost for end in ends], 0.0) / 2)
    scatter = np.einsum("e,ei,ej->ij", share / share.sum(), off, off)
    scatter += np.outer(off[0], off[0]) / 2  # the dip that it fell into, and another
    widened = dataclasses.replace(best, covariance=best.covariance + scatter)
    return _with_last(hypothesis, widened, own, kinds)


def _friction(fit: Fit, kinds: Mapping[str, Kind]) -> int | None:
    """Give the place of dry friction among what was fitted: of the first of two."""
    for which, effect in enumerate(fit.plant.effects):
        name = ("effect", which, kinds[effect.kind].strength)
        if isinstance(kinds[effect.kind].action, Friction) and name in fit.prior.names:
            return fit.prior.names.index(name)
    return None


def _ends_beside(
    last: Fit, lead: int, trials: Sequence[Trial], late: Callable[[], bool]
) -> tuple[Fit, list[Fit]]:
    """Give the best fit, and where all fits ended until one was given up."""
    best, ends = last, [last]
    for _ in range(MAX_ROUNDS):
        for end in _held(best, lead, trials, late):
            if end is None:
                return best, ends
            ends.append(end)
        least = min(ends, key=lambda fit: fit.cost)
        if least.cost >= best.cost:
            break
        again = attempt(
            refit, last.plant, trials, noise=last.noise, values=least.values,
            states=least.states, horizons=(1.0,),
            control=FitControl(to_convergence=True, is_late=late),
        )  # fmt: skip
        if again is None:
            break
        best = again
        ends.append(best)
    return best, ends


def _held(
    best: Fit, lead: int, trials: Sequence[Trial], late: Callable[[], bool]
) -> Iterator[Fit | None]:
    """Fit all but one number, which is held here and there; the others go with it at first."""
    free = [name for at, name in enumerate(best.prior.names) if at != lead]
    along = best.covariance[:, lead] / np.sqrt(best.covariance[lead, lead])
    for width in HELD_SDS:
        values = best.values.copy()
        values[list(best.prior.index)] += width * along
        if values[best.prior.index[lead]] <= 0:
            continue  # no friction at all is another model
        yield attempt(
            refit, best.plant, trials, free=free, noise=best.noise, values=values,
            states=best.states, horizons=(1.0,), control=FitControl(is_late=late),
        )  # fmt: skip


def _is_explained(hypothesis: Hypothesis, kinds: Mapping[str, Kind]) -> bool:
    """Return whether the last model is fitted to whole records, and explains them."""
    last = hypothesis.last
    actions = (kinds[effect.kind].action for effect in last.plant.effects)
    moving = not any(isinstance(action, Unmeasured) for action in actions)
    whole = hypothesis.last_fits_whole_records and not hypothesis.final
    return whole and moving and last.chi2_in_band <= WRONG_MODEL_CHI2


def _with_last(
    hypothesis: Hypothesis, fit: Fit, own: int, kinds: Mapping[str, Kind]
) -> Hypothesis:
    """Take another fit of the last model, and read the parameters of the effects off it."""
    if len(fit.plant.effects) == own + len(hypothesis.effects):
        return hypothesis.with_last(fit, kinds)
    return dataclasses.replace(hypothesis, fits=(*hypothesis.fits[:-1], fit))

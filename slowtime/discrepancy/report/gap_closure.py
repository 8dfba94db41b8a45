"""A gap without a name closed by a measured force surface, and what that surface resembles."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.estimation.candidate_fit import FittedCandidate, misfit
from slowtime.discrepancy.estimation.shooting_fit import unexplained_by
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.localization import Localization
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refinement.force_surface import fit_force_surface
from slowtime.discrepancy.validation.free_run import (
    FreeRunResult,
    evaluate_free_run,
    refit_on_heads,
)
from slowtime.dynamics.effects import Kind, Place

MIN_LIKENESS = 0.5
"""[share of the recovered force] That a law has to explain to be said to be like the surface.
Source: a decision: below half, most of the force is another's."""
MAX_LIKE = 2
"""[laws] That are named. Source: a decision."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ClosedGap:
    """A model with a measured force surface, and its free run on what was not fitted.

    Parameters
    ----------
    place
        Element that the force acts in.
    fit
        With the surface as its last effect.
    result
        Its free run.
    """

    place: Place
    fit: Fit
    result: FreeRunResult

    @property
    def error(self) -> float:
        """Relative error of the free run [1], the mean over its sensors."""
        return float(self.result.error.mean())


def close_gap(
    found: Hypothesis,
    trials: tuple[Trial, ...],
    tests: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
    *,
    held_out: bool,
) -> ClosedGap | None:
    """Fit a force surface beside the model as given, and beside the effects that were nearest.

    Parameters
    ----------
    trials
        Records to fit.
    tests
        Records that the free run is judged on.
    held_out
        Whether these were held out; the last thirds of the fitted records otherwise.

    Returns
    -------
    The one that leaves less of the fitted records; None where none could be fitted.
    """
    fitted = [
        one
        for before, localized in _starts(found, trials)
        if (one := fit_force_surface(before, localized, trials, kinds)) is not None
    ]
    if not fitted:
        return None
    best = _best(fitted, trials)
    fit = best.fit if held_out else refit_on_heads(best.fit, trials)
    values = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    result = evaluate_free_run(with_values(fit.plant.description, values), fit, tests)
    return ClosedGap(best.effect.place, best.fit, result)


def _starts(found: Hypothesis, trials: Sequence[Trial]) -> Iterator[tuple[Fit, Localization]]:
    if found.localized is not None and len(found.first.states) == len(trials):
        yield found.first, found.localized
    if found.effects and found.rest is not None and len(found.last.states) == len(trials):
        yield found.last, found.rest


def _best(fitted: Sequence[FittedCandidate], trials: Sequence[Trial]) -> FittedCandidate:
    noise = min((one.fit for one in fitted), key=unexplained_by).noise
    return min(fitted, key=lambda one: misfit(one.fit, noise, trials))


def describe_gap_closure(
    closed: ClosedGap, before: float, found: Hypothesis, kinds: Mapping[str, Kind]
) -> str:
    """Say what the surface is, how much of the gap it closes, and which laws it resembles.

    Parameters
    ----------
    before
        Relative error [1] of the refitted model without it.
    """
    effect = closed.fit.plant.effects[-1]
    reach, speed = effect.parameters["e0_m"], effect.parameters["v0_m_per_s"]
    unit = closed.fit.plant.description.unit_of_coordinate
    share = 100 * (1 - closed.error / before)
    text = (
        f"A force surface was measured at {closed.place} instead (measured_force): with it the "
        f"augmented model closes {share:.0f} % of what the refitted one leaves. It was "
        f"measured up to {reach:.2g} {unit} and {speed:.2g} {unit}/s; beyond that it is only "
        "held constant."
    )
    like = _resembles(found, closed.place)
    if like:
        names = " and ".join(f"{kinds[kind].words} ({100 * s:.0f} %)" for kind, s in like)
        text += f" Of the laws known here, it is most like {names} along the motion."
    return text


def _resembles(found: Hypothesis, place: Place) -> list[tuple[str, float]]:
    """List laws at a place by the share of the recovered force that they explain."""
    shares: dict[str, float] = {}
    for one in found.tried:
        if one.effect.place == place and one.cost_without > 0:
            share = 1 - one.cost / one.cost_without
            shares[one.effect.kind] = max(shares.get(one.effect.kind, 0.0), share)
    ranked = sorted(shares.items(), key=lambda item: -item[1])
    return [item for item in ranked[:MAX_LIKE] if item[1] >= MIN_LIKENESS]

"""Adoption of a measured force surface where no law explains the records."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.estimation.shooting_fit import unexplained_by
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refinement.force_surface import (
    AUTO,
    ShapedRegression,
    SurfaceDemand,
    SurfaceFit,
    fit_force_surface,
    surface_band,
)
from slowtime.discrepancy.time_limit import budget_share, leave_out
from slowtime.discrepancy.validation.free_run import (
    FreeRunResult,
    evaluate_free_run,
    refit_on_heads,
)
from slowtime.dynamics.effects import Kind, Motion, Place

from .likeness import Likeness, describe_likeness

NO_ELEMENT = "No force surface was fitted: at no element does a force stand out from the noise."
UNTRIED = "No force surface was fitted: there was no time for it. Raise --patience."


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ClosedGap:
    """A model with a measured force surface, and its free run on what was not fitted."""

    place: Place
    fit: Fit
    result: FreeRunResult
    finished: bool
    shaped: ShapedRegression

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
    error: float,
    demand: SurfaceDemand = AUTO,
) -> ClosedGap | str:
    """Fit a force surface beside the model as given, and adopt it where it predicts better.

    A surface that leaves more of the records than the model without it is fitted again, from
    none. Without held-out tests, these are the last thirds of the fitted records. Gives a
    sentence that says why, where none is adopted.
    """
    before, localized = found.first, found.localized
    if localized is None or len(before.states) != len(trials):
        return NO_ELEMENT
    if leave_out("the force surface"):
        return UNTRIED
    one = fit_force_surface(before, localized, trials, kinds, demand=demand)
    lost = one is None or not _explains(one, before)
    if lost and not leave_out("a force surface that begins without a force"):
        flat = fit_force_surface(before, localized, trials, kinds, demand=demand, flat=True)
        one = flat or one
    if one is None:
        return UNTRIED if leave_out("the force surface") else NO_ELEMENT
    if not _explains(one, before):
        return (
            f"A force surface was fitted at {one.place}, but not adopted: with it, the "
            "model leaves more of the training records than without it."
        )
    fit = one.fit if held_out else refit_on_heads(one.fit, trials, one.free)
    values = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    result = evaluate_free_run(with_values(fit.plant.description, values), fit, tests)
    closed = ClosedGap(one.place, one.fit, result, one.finished, one.shaped)
    if closed.error < error:
        return closed
    cut = "" if closed.finished else " Its fit was stopped by the computing budget."
    return (
        f"A force surface was fitted at {closed.place}, but not adopted: with it the error "
        f"on the validation data is {100 * closed.error:.2g} %, without it "
        f"{100 * error:.2g} %.{cut}{_describe_refusals(closed.shaped)}"
    )


def _explains(one: SurfaceFit, before: Fit) -> bool:
    """Whether a surface leaves less of the training records than the fit without it."""
    return unexplained_by(one.fit) < unexplained_by(before)


def describe_gap_closure(
    closed: ClosedGap, before: float, like: Sequence[Likeness], kinds: Mapping[str, Kind]
) -> str:
    """Say what the surface is, how much of the gap it closes, and which laws it resembles."""
    effect = closed.fit.plant.effects[-1]
    own = effect.parameters
    unit = closed.fit.plant.description.unit_of_coordinate
    share = 100 * (1 - closed.error / before)
    still = Motion(e=np.zeros(1), v=np.zeros(1), a=np.zeros(1), times=np.zeros(1))
    edge = dataclasses.replace(still, e=np.array([own["high_m"]]))
    sds = [float(surface_band(closed.fit, one)[1][0]) for one in (still, edge)]
    text = (
        f"Instead of a law, a force surface was fitted at {closed.place} ({effect.kind}): it "
        f"reduces the error of the refitted model by {share:.0f} %. It was "
        f"measured from {own['low_m']:.2g} to {own['high_m']:.2g} {unit} and up to "
        f"{own['high_m_per_s']:.2g} {unit}/s, with a standard deviation of "
        f"{sds[0]:.2g} at rest and {sds[1]:.2g} at the edge (N, or N m); beyond that "
        "it is extrapolated linearly, which no record supports."
    )
    if not closed.finished:
        text += " Its fit was stopped by its own computing budget"
        text += (
            ", which grows with --patience."
            if budget_share() < 1
            else "; --patience does not change that."
        )
    text += _describe_shape(closed.shaped) + _describe_refusals(closed.shaped)
    text += _describe_level(closed)
    return text + describe_likeness(like, kinds, unit)


def _describe_shape(shaped: ShapedRegression) -> str:
    """Say which shape the surface has, and why."""
    if not shaped.shape.words:
        return ""
    ways = [
        f"{'rises' if way > 0 else 'falls'} with the {name}"
        for way, name in (
            (shaped.shape.monotone_e, "elongation"), (shaped.shape.monotone_v, "rate"),
        )
        if way
    ]  # fmt: skip
    told = f" The surface is {shaped.shape.words}"
    told += f" (it {' and '.join(ways)})" if ways else ""
    if shaped.gain > 0:
        return f"{told}: the log evidence is {shaped.gain:.2g} higher than without."
    return f"{told}, as --setting surface demands."


def _describe_level(closed: ClosedGap) -> str:
    """Say what the stiffness slowly changes with, and by how much."""
    plant = closed.fit.plant
    own = plant.effects[-1].parameters
    if "xl1_n" not in closed.shaped.terms.leading:
        return ""
    number = len(plant.effects) - 1
    named = dict(zip(plant.parameters, closed.fit.values.tolist(), strict=True))
    one, two, three = (named["effect", number, f"xl{i}_n"] for i in (1, 2, 3))
    unit = plant.description.unit_of_coordinate
    level, cause, when = {
        0.0: (
            "recent vibration",
            f"the last {own['level_s']:.2g} s",
            "vibration of mean level",
        ),
        1.0: (
            "largest elongation so far",
            "since a record began",
            "the largest elongation",
        ),
        2.0: ("age", f"a time constant of {own['level_s']:.2g} s", "long times"),
    }[own["level_of"]]
    size = 0.5 if own["level_of"] == 0.0 else 1.0
    change = (one + (two + three * size) * size) * size / max(-own["low_m"], own["high_m"])
    stiffness = "N m/rad" if unit == "rad" else f"N/{unit}"
    return (
        f" Its stiffness changes with the {level} ({cause}): at {when} it is {change:+.2g} "
        f"{stiffness} beside the element's own."
    )


def _describe_refusals(shaped: ShapedRegression) -> str:
    """Say which demanded shape the records contradict."""
    return "".join(
        f" The demanded shape, {words}, does not fit these records: it would lower the log "
        f"evidence{f' by {loss:.2g}' if np.isfinite(loss) else ''}, so the surface was fitted "
        "without it. Use --setting surface=auto, or give records of more motion if you know "
        "that the "
        "force has this shape."
        for words, loss in shaped.refused
    )

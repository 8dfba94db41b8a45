"""The model that is adopted: fitted, refitted to free runs, or with a force surface."""

import dataclasses
from collections.abc import Mapping

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.diagnosis import Number
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import moved_of, renumbered, requoted_by_place
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refinement.force_surface import SurfaceDemand
from slowtime.discrepancy.refinement.free_run_refit import (
    FreeRunRefit,
    refit_plainly_on_heads,
    refit_to_free_runs,
)
from slowtime.discrepancy.validation.free_run import FreeRunResult, evaluate_free_run
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Kind

from .evaluation import Evaluation, described
from .gap_closure import ClosedGap, close_gap
from .judgement import JudgedHypothesis

NO_SURFACE = (
    "No force surface was fitted: what is missing is an unmeasured motion, not a force in an "
    "element of the model."
)


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class KeptModel:
    """The model that is adopted, and its free run on what was not fitted.

    Parameters
    ----------
    closed
        A force surface that closes the gap, where the effect is unknown and one does.
    useless
        Whether the model as given does better than the fitted one, and is kept.
    refitted
        The refit of its constants to the plain error of free runs, where that is adopted.
    """

    fit: Fit
    result: FreeRunResult
    closed: ClosedGap | None = None
    why_open: str | None = None
    useless: bool = False
    refitted: FreeRunRefit | None = None


def kept_model(
    judged: JudgedHypothesis,
    evaluation: Evaluation,
    trials: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
    monitor: Monitor | None,
    surface: SurfaceDemand,
) -> KeptModel:
    """Close the gap by a force surface where the effect is unknown, or keep what there is."""
    found = judged.found
    if not judged.unknown:
        kept = KeptModel(fit=found.last, result=evaluation.steps[-1])
        if monitor is None:
            return kept
        return _refitted_to_free_runs(kept, found, evaluation, trials, monitor)
    # An effect in the model is one that is believed; what came near is told in words. Constants
    # that were bent to imitate an unknown effect do not make a better model either.
    useless = evaluation.refitted_is_worse
    result = evaluation.nominal if useless else evaluation.steps[0]
    closed = (
        _closed(found, trials, evaluation, result, kinds, monitor, surface) if monitor else None
    )
    if isinstance(closed, ClosedGap):
        return KeptModel(fit=closed.fit, result=closed.result, closed=closed)
    return KeptModel(fit=found.first, result=result, why_open=closed, useless=useless)


def requoted_judgement(
    judged: JudgedHypothesis, kept: KeptModel, kinds: Mapping[str, Kind]
) -> JudgedHypothesis:
    """Quote the parameters as the last refit leaves them, the verdict being what it is."""
    if kept.refitted is None:
        return judged
    estimate = kept.refitted.estimate
    effects = tuple(requoted_by_place(judged.found.effects, estimate, kinds))
    return dataclasses.replace(
        judged,
        found=dataclasses.replace(judged.found, effects=effects),
        effects=tuple(requoted_by_place(judged.effects, estimate, kinds)),
    )


def _refitted_to_free_runs(
    kept: KeptModel,
    found: Hypothesis,
    evaluation: Evaluation,
    trials: tuple[Trial, ...],
    monitor: Monitor,
) -> KeptModel:
    """Refit the constants of a model with effects to free runs, where that predicts better."""
    if not found.effects or found.final or not found.last_fits_whole_records:
        return kept

    def tell() -> None:
        monitor("refitting constants to free runs", 0.97)

    refitted = refit_to_free_runs(found.last, trials, tell)
    if refitted is None:
        return kept
    fit = refitted.fit
    ahead = fit if evaluation.held_out else refit_plainly_on_heads(fit, trials)
    result = evaluate_free_run(described(ahead), ahead, evaluation.tests)
    return dataclasses.replace(kept, fit=fit, result=result, refitted=refitted)


def _closed(
    found: Hypothesis,
    trials: tuple[Trial, ...],
    evaluation: Evaluation,
    kept: FreeRunResult,
    kinds: Mapping[str, Kind],
    monitor: Monitor,
    surface: SurfaceDemand,
) -> ClosedGap | str:
    """Close the gap by a force surface, where that does better on what was not fitted."""
    if found.final:
        return NO_SURFACE
    monitor("measuring the force surface", 0.94)
    return close_gap(
        found,
        trials,
        evaluation.tests,
        kinds,
        held_out=evaluation.held_out,
        error=float(kept.error.mean()),
        demand=surface,
    )


def moved_constants(kept: KeptModel, given: Description) -> dict[str, Number]:
    """Give constants of the model that left their tolerance, with the values that are kept."""
    return {} if kept.useless else moved_of(kept.fit) | renumbered(kept.fit, given)

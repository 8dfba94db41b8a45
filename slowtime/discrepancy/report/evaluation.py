"""Free runs of a hypothesis' models on records that were not fitted."""

import dataclasses
from collections.abc import Mapping

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.data.clock_overrun import mask_clock_overrun
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.noise import Noise
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.validation.free_run import (
    FreeRunResult,
    evaluate_free_run,
    evaluation_trials,
    noise_floor_error,
    noise_of_runs,
    refit_on_heads,
)
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Kind


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Evaluation:
    """Free runs of the models on records that were not fitted.

    Parameters
    ----------
    tests
        Records that were held out, or the last third of each record.
    steps
        Of the refitted model, and of the model after each effect.
    floor
        Relative error of that noise alone [1].
    """

    tests: tuple[Trial, ...]
    held_out: bool
    nominal: FreeRunResult
    steps: tuple[FreeRunResult, ...]
    noise: Noise
    floor: float

    @property
    def errors(self) -> list[float]:
        """Relative error of each step [1], the mean over its sensors."""
        return [float(step.error.mean()) for step in self.steps]

    @property
    def refitted_is_worse(self) -> bool:
        """Whether the refitted model does worse on held-out records than the model as given."""
        return self.held_out and self.errors[0] > float(self.nominal.error.mean())


def evaluate(
    campaign: Campaign, trials: tuple[Trial, ...], found: Hypothesis, kinds: Mapping[str, Kind]
) -> Evaluation:
    """Simulate the model as given, refitted, and after each effect, on what was not fitted."""
    given, first, held_out = campaign.description, found.first, bool(campaign.holdout)
    channels = tuple(sensor.channel for sensor in given.sensors)
    tests = evaluation_trials(trials, campaign.holdout)
    # A fast clock claims samples after the end of the record, which no model can predict.
    tests = mask_clock_overrun(
        tests, channels, (answer.effect for answer in found.effects), kinds
    )
    as_given = dataclasses.replace(first, values=first.plant.values)
    nominal = evaluate_free_run(given, as_given, tests)
    ahead = found.fits if held_out else [refit_on_heads(fit, trials) for fit in found.fits]
    steps = tuple(evaluate_free_run(described(fit), fit, tests) for fit in ahead)
    noise = noise_of_runs(found.last, tests, steps[-1].runs)
    return Evaluation(
        tests=tests,
        held_out=held_out,
        nominal=nominal,
        steps=steps,
        noise=noise,
        floor=noise_floor_error(tests, noise),
    )


def described(fit: Fit) -> Description:
    """Give the model file of a fit, with its constants and effects."""
    values = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    return with_values(fit.plant.description, values)

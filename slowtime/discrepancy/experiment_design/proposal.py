r"""Choice of the experiment that discriminates between rival models.

All are simulated in each of a list of experiments. Differences that one can reproduce by moving
its parameters within their covariance do not count:

.. math:: \Delta = \tfrac12 \min_\delta \; |(y_1 - y_2 - S \delta) / \sigma|^2
          + \delta^T \Sigma^{-1} \delta ,

with the sensitivities :math:`S` and the covariance :math:`\Sigma` of the second one's fit.
Either may be true: the lesser of both directions counts, and of several rivals the least
separated pair. Where no experiment separates them all, the least likely are left out in turn.

References
----------
.. [1] G. E. P. Box, W. J. Hill, "Discrimination among mechanistic models", Technometrics 9
   (1967).
"""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import scipy.linalg
from jaxtyping import Float

from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.diagnosis import Experiment
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.time_limit import leave_out
from slowtime.dynamics.effects import Kind
from slowtime.dynamics.plant import Plant

from .options import experiment_options, experiment_trial

AMPLE_SEPARATION = 60.0
"""[nats] Expected log evidence that decides even where models are only nearly right. Source:
docs/what_decides.md: half and double change no answer."""
DECISIVE_SEPARATION = 12.0
"""[nats] Expected log evidence that decides; more effort is not worth more. Source: twice
`LIMITS.least_log_evidence`."""
MIN_SEPARATION = 1.0
"""[nats] Below which nothing is proposed. Source: odds below e."""
MAX_SEPARATION = 1e6
"""[nats] Beyond which models have parted for good. Source: a bound for sums and prints."""
LEVEL_MARGIN = 1.4
"""[1] Times its level at which a louder experiment must leave every rival bounded. Source:
docs/what_decides.md: half and double change no answer."""
MAX_RIVALS = 6
"""[1] Rivals that are compared. Source: docs/what_decides.md: half and double change no
answer."""

Series = Float[np.ndarray, "time sensor"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Prediction of an experiment by one rival.

    Parameters
    ----------
    outputs, slopes
        Outputs (time, sensor), and their sensitivities to free parameters and to the initial
        state, which is unknown.
    """

    outputs: Series
    slopes: Float[np.ndarray, "time sensor free"]
    noise: Float[np.ndarray, " sensor"]
    known: Float[np.ndarray, "free free"]


def propose_experiment(
    rivals: Sequence[FittedCandidate], trials: Sequence[Trial], kinds: Mapping[str, Kind]
) -> Experiment | None:
    """Choose the easiest experiment that separates rivals; None where none would."""
    rivals = rivals[:MAX_RIVALS]
    if len(rivals) < 2:
        return None
    efforts = experiment_options(rivals[0].description, trials)
    apart = functools.cache(lambda option: separations(rivals, option, trials, kinds))
    # Better to separate the likeliest than none, where two rivals agree everywhere.
    for number in reversed(range(len(rivals) - 1)):
        found = _easiest(efforts, apart, number)
        if found is not None:
            return found
    return None


def _easiest(
    efforts: Sequence[Sequence[Experiment]],
    apart: Callable[[Experiment], Sequence[float]],
    number: int,
) -> Experiment | None:
    """Choose the easiest experiment that separates the first rivals, up to a number."""
    best: Experiment | None = None
    for effort in efforts:
        for option in effort:
            if leave_out("experiments that may tell rivals apart"):
                return best
            told = dataclasses.replace(option, separation=apart(option)[number])
            if best is None or told.separation > best.separation:
                best = told
            if told.separation > AMPLE_SEPARATION:
                return told
        if best is not None and best.separation > DECISIVE_SEPARATION:
            return best
    return best if best is not None and best.separation > MIN_SEPARATION else None


def separations(
    rivals: Sequence[FittedCandidate],
    option: Experiment,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
) -> list[float]:
    """Least separation among the first two rivals, the first three, and so on [nats].

    The strongest of the trials is repeated.
    """
    strongest = _strongest(trials)
    trial = trials[strongest]
    later = max(t.start_s + t.duration_s for t in trials)
    start = later if option.start_s is None else option.start_s
    acts = experiment_trial(option, trial, rivals[0].description)
    # A rival near an instability may diverge at a slightly higher level.
    repeated = option.excitation is None and not option.add_inputs
    loud = LEVEL_MARGIN * (option.level * trial.inputs if repeated else acts.inputs)
    told: list[Prediction] = []
    least: list[float] = []
    for rival in rivals:
        released = option.excitation == "release"
        state0 = option.level * rival.fit.states[strongest] if released else None
        one = predict(rival, option, acts, start, kinds, state0)
        if one is None or (
            option.level > 1
            and not released
            and not _stays_bounded(rival, option, loud, acts, kinds)
        ):
            break
        pairs = ((one, other) for other in told)
        apart = [min(separation(*pair), separation(*pair[::-1])) for pair in pairs]
        least += [min([*least[-1:], *apart])] if apart else []
        told.append(one)
    return [*least, *[0.0] * (len(rivals) - 1 - len(least))]


def _strongest(trials: Sequence[Trial]) -> int:
    """Give the number of the record with the largest inputs, or motion where there are none."""
    driven = any(trial.inputs.any() for trial in trials)
    sizes = [(t.inputs if driven else t.measured).var(axis=0).sum() for t in trials]
    return int(np.argmax(sizes))


def predict(
    named: FittedCandidate,
    option: Experiment,
    trial: Trial,
    start_s: float,
    kinds: Mapping[str, Kind],
    state0: Float[np.ndarray, " state"] | None = None,
) -> Prediction | None:
    """Simulate an experiment with one rival; None where it diverges.

    It begins at rest where no state is given, at the campaign time `start_s` [s].
    """
    plant, fit = _plant_of_rival(named, option, kinds), named.fit
    with np.errstate(all="ignore"):
        outputs, slopes = plant.sensitivities(
            plant.values, trial.inputs, trial.rate_hz, fit.prior.names,
            state0=state0, start_s=start_s,
        )  # fmt: skip
    if not (np.isfinite(outputs).all() and np.isfinite(slopes).all()):
        return None
    noise = fit.noise.sd(0, trial.rate_hz)
    there = len(noise)
    # An additional sensor is taken to be as good as the worst of those there are.
    relative = float(np.max(noise / np.maximum(outputs[:, :there].std(axis=0), 1e-300)))
    more = min(relative, 0.1) * outputs[:, there:].std(axis=0)
    free = len(fit.prior.names)
    known = np.zeros((slopes.shape[2], slopes.shape[2]))
    known[:free, :free] = scipy.linalg.pinvh(fit.covariance)
    return Prediction(
        outputs=outputs, slopes=slopes, noise=np.concatenate([noise, more]), known=known
    )


def _stays_bounded(
    named: FittedCandidate,
    option: Experiment,
    inputs: Series,
    trial: Trial,
    kinds: Mapping[str, Kind],
) -> bool:
    """Whether the run of a rival stays finite under inputs."""
    plant = _plant_of_rival(named, option, kinds)
    with np.errstate(all="ignore"):
        outputs = plant.simulate(plant.values, inputs, trial.rate_hz)
    return bool(np.isfinite(outputs).all())


def separation(true: Prediction, other: Prediction) -> float:
    """Give the expected log evidence of the true model over another [nats]."""
    if not (other.noise > 0).all() or not np.isfinite(other.slopes).all():
        return 0.0  # nothing moves, or a run grows beyond bounds: no experiment
    apart = ((true.outputs - other.outputs) / other.noise).ravel()
    if not np.isfinite(apart).all():
        return 0.0
    turned = (other.slopes / other.noise[:, None]).reshape(len(apart), -1)
    matrix, right = turned.T @ turned + other.known, turned.T @ apart
    size = 1 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    inner = matrix * np.outer(size, size) + 1e-10 * np.eye(len(matrix))
    mimic = float(right @ (size * scipy.linalg.solve(inner, size * right, assume_a="pos")))
    return float(np.clip((apart @ apart - mimic) / 2, 0.0, MAX_SEPARATION))


def _plant_of_rival(
    named: FittedCandidate, option: Experiment, kinds: Mapping[str, Kind]
) -> Plant:
    """Model of a rival with the inputs and sensors of the experiment."""
    values = dict(zip(named.fit.plant.parameters, named.fit.values.tolist(), strict=True))
    description = with_values(named.description, values)
    description = dataclasses.replace(
        description,
        sensors=(*description.sensors, *option.add_sensors),
        inputs=(*description.inputs, *option.add_inputs),
    )
    return Plant.of(description, kinds=kinds)

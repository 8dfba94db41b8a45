"""Errors of free runs on records that were held out, and their noise floor."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.calibration import (
    Fit,
    first_periods,
    motion_amplitude,
    multistart_initial_state,
    state_from_sensors,
    try_refit,
)
from slowtime.discrepancy.diagnosis import Spectra, Traces
from slowtime.discrepancy.noise import Noise, estimate_noise
from slowtime.discrepancy.records import MIN_SAMPLES, Trial
from slowtime.dynamics.description import Description
from slowtime.dynamics.plant import Name, Plant
from slowtime.signals.spectra import transform

START_SHARE = 0.2
"""[share of a record] From which its initial state is estimated. Source: docs/what_decides.md:
half and double change no answer."""
LOST_CHI2 = 30.0
"""[noise variances] Mean square of the first samples from which a run began in the wrong
minimum. Source: docs/what_decides.md: half and double change no answer."""
SPECTRUM_POINTS = 400
"""[1] Of spectra that are drawn, at most. Source: points that a screen shows apart."""

Series = Float[np.ndarray, "time sensor"]


def evaluation_trials(
    trials: tuple[Trial, ...], holdout: tuple[Trial, ...]
) -> tuple[Trial, ...]:
    """Give the records for evaluation: those held out, or else the last third of each."""
    return holdout or tuple(tail_of(trial) for trial in trials)


def learnt_and_unseen(
    trials: tuple[Trial, ...], holdout: tuple[Trial, ...]
) -> tuple[tuple[Trial, ...], tuple[Trial, ...]]:
    """Give the records that are fitted once, and those for evaluation."""
    tests = evaluation_trials(trials, holdout)
    return (trials if holdout else heads_of(trials) or trials), tests


def tail_of(trial: Trial) -> Trial:
    """Last third of a record; all of it where that is too short."""
    begun = len(trial.outputs) * 2 // 3
    if len(trial.outputs) - begun < MIN_SAMPLES:
        return trial
    return trial.part(begun, len(trial.outputs))


def heads_of(trials: Sequence[Trial]) -> tuple[Trial, ...]:
    """First two thirds of each record; none where one of them is too short."""
    ends = [len(trial.outputs) * 2 // 3 for trial in trials]
    if min(ends) < MIN_SAMPLES:
        return ()
    return tuple(trial.part(0, end) for trial, end in zip(trials, ends, strict=True))


def refit_on_heads(
    fit: Fit, trials: Sequence[Trial], free: Sequence[Name] | None = None
) -> Fit:
    """Refit a model to all but the tails of records; the given fit where that diverges."""
    heads = heads_of(trials)
    if not heads:
        return fit
    states = fit.states if len(fit.states) == len(heads) else None
    found = try_refit(
        fit.plant, heads, free=free, noise=fit.noise if states else None, values=fit.values,
        states=states, horizons=(1.0,),
    )  # fmt: skip
    return found or fit


def free_runs(fit: Fit, trials: Sequence[Trial]) -> list[Series]:
    """Simulate the model of a fit on other records.

    Initial states are estimated from the first samples of each; outputs (time, sensor) are in
    the sensors' units.
    """
    runs = []
    for trial in trials:
        state = _initial_state(fit, _first_part(trial), _noise_of_first_record(fit))
        runs.append(
            fit.plant.simulate(
                fit.values,
                trial.inputs,
                trial.rate_hz,
                state0=state,
                start_s=trial.start_s,
            )
        )
    return runs


def refit_on_record(fit: Fit, trial: Trial) -> Fit | None:
    """Refit a model to another record, whose noise is estimated anew."""
    state = _initial_state(fit, _first_part(trial), _noise_of_first_record(fit))
    return try_refit(fit.plant, (trial,), values=fit.values, states=[state], horizons=(1.0,))


def _first_part(trial: Trial) -> Trial:
    return trial.part(0, max(int(START_SHARE * len(trial.outputs)), 64))


def _noise_of_first_record(fit: Fit) -> Noise:
    """Noise of the first fitted record, used for others."""
    drift = fit.noise.drift
    first = None if drift is None else drift.first()
    return dataclasses.replace(fit.noise.for_trials([0]), drift=first)


def _initial_state(fit: Fit, part: Trial, noise: Noise) -> Float[np.ndarray, " state"]:
    """Estimate the initial state from the first samples."""
    plant, values = fit.plant, fit.values
    bare = Plant.of(dataclasses.replace(plant.description, effects=()), kinds=plant.kinds)
    known = dict(zip(plant.parameters, values.tolist(), strict=True))
    own = np.array([known[name] for name in bare.parameters])
    straight = _fit_initial_state(bare, part, noise, own, None)
    found = [straight]
    # A joint that sticks does not determine its speed: with effects, fits start from the state
    # of the model without them, too.
    if plant.effects:
        state = (
            {}
            if straight is None
            else dict(zip(bare.state_names, straight.states[0].tolist(), strict=False))
        )
        begun = np.array([state.get(name, 0.0) for name in plant.state_names])
        heard = state_from_sensors(plant, part, begun)
        starts = [None, [begun], *([] if np.array_equal(heard, begun) else [[heard]])]
        found = [_fit_initial_state(plant, part, noise, values, start) for start in starts]
    ended = [one for one in found if one is not None]
    if not ended:
        return np.zeros(len(plant.state_names))
    best = min(ended, key=lambda one: one.cost)
    if plant.effects and best.cost > LOST_CHI2 * best.data:
        best = _multistart(best, part)
    return best.states[0]


def _multistart(fit: Fit, part: Trial) -> Fit:
    """Search the initial state by multistart over the first periods; the better of both."""
    (first,) = first_periods(fit.plant, (part,))
    size = motion_amplitude(fit.plant, part, fit.values, fit.states[0])
    state = multistart_initial_state(
        fit.plant, first, fit.noise, fit.values, fit.states[0], size
    )
    other = _fit_initial_state(fit.plant, part, fit.noise, fit.values, (state,))
    return other if other is not None and other.cost < fit.cost else fit


def _fit_initial_state(
    plant: Plant,
    part: Trial,
    noise: Noise,
    values: Float[np.ndarray, " parameter"],
    states: Sequence[Float[np.ndarray, " state"]] | None,
) -> Fit | None:
    """Fit initial states alone; None where the run diverges."""
    return try_refit(
        plant, (part,), free=[], noise=noise, values=values, states=states, horizons=(1.0,)
    )


def relative_errors(
    trials: Sequence[Trial], runs: Sequence[Series]
) -> Float[np.ndarray, " sensor"]:
    """Root mean square error of free runs over the standard deviation of the outputs.

    By sensor [1]; 0 for one without variation, 1e6 for a run that is not finite.
    """
    found = []
    for sensor in range(trials[0].outputs.shape[1]):
        left, all_of = [], []
        for trial, run in zip(trials, runs, strict=True):
            use = trial.used[:, sensor]
            left.append((trial.outputs - run)[use, sensor])
            all_of.append(trial.outputs[use, sensor])
        told = np.concatenate(all_of)
        scatter = float(np.std(told)) if told.size else 0.0
        error = float(np.sqrt(np.mean(np.concatenate(left) ** 2))) if scatter > 0 else 0.0
        found.append(error / scatter if scatter > 0 else 0.0)
    return np.array([e if math.isfinite(e) else 1e6 for e in found])


def noise_of_runs(fit: Fit, trials: tuple[Trial, ...], runs: Sequence[Series]) -> Noise:
    """Estimate the noise of records that were not fitted from the errors of free runs."""
    left = tuple(
        np.where(trial.used & np.isfinite(run), trial.measured - run, 0.0)
        for trial, run in zip(trials, runs, strict=True)
    )
    return estimate_noise(trials, left, silent_above_hz=fit.silent_above_hz)


def noise_floor_error(trials: Sequence[Trial], noise: Noise) -> float:
    """Relative error that the sensors' noise alone causes, averaged over them [1]."""
    share = np.array([t.used.mean(axis=0) for t in trials])
    power = np.array([noise.sd(i, t.rate_hz) ** 2 for i, t in enumerate(trials)])
    power = np.sum(share * power, axis=0) / np.maximum(share.sum(axis=0), 1e-12)
    found = []
    for sensor, size in enumerate(np.sqrt(power)):
        told = np.concatenate([t.outputs[t.used[:, sensor], sensor] for t in trials])
        scatter = float(np.std(told)) if told.size else 0.0
        found.append(size / scatter if scatter > 0 else 0.0)
    return float(np.mean(found))


def traces_of(
    trials: Sequence[Trial], nominal: list[Series], refits: list[Series], last: list[Series]
) -> tuple[Traces, ...]:
    """Collect measured and simulated outputs of each record."""
    return tuple(
        Traces(t.times_s, t.outputs, a, b, c)
        for t, a, b, c in zip(trials, nominal, refits, last, strict=True)
    )


def spectra_of(
    trials: Sequence[Trial], before: list[Series], after: list[Series], noise: Noise
) -> Spectra:
    """Mean densities of outputs, residuals and noise, as fine as the shortest record allows."""
    top = max(trial.rate_hz for trial in trials) / 2
    finest = min(int(len(trial.outputs) * top / trial.rate_hz) for trial in trials)
    points = int(np.clip(finest // 2, 1, SPECTRUM_POINTS))
    edges = np.linspace(0.0, top, points + 1)
    middle = (edges[:-1] + edges[1:]) / 2

    def mean(series: Sequence[Series]) -> Float[np.ndarray, "frequency sensor"]:
        total = np.zeros((points, series[0].shape[1]))
        records = np.zeros((points, 1))
        for one, trial in zip(series, trials, strict=True):
            frequency, spectrum = transform(np.nan_to_num(one), trial.rate_hz)
            own = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, points - 1)
            count = np.bincount(own, minlength=points)
            records[:, 0] += count > 0
            for sensor in range(one.shape[1]):
                power = np.abs(spectrum[:, sensor]) ** 2
                total[:, sensor] += np.bincount(own, power, points) / np.maximum(count, 1)
        return total / np.where(records > 0, records, np.nan)

    measured = [trial.measured for trial in trials]
    left = [
        np.where(t.used, m - b, 0) for t, m, b in zip(trials, measured, before, strict=True)
    ]
    rest = [np.where(t.used, m - a, 0) for t, m, a in zip(trials, measured, after, strict=True)]
    return Spectra(middle, mean(measured), mean(left), mean(rest), noise.density(0, middle))


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FreeRunResult:
    """Free runs of one model, with their relative errors by sensor."""

    description: Description
    runs: list[Series]
    error: Float[np.ndarray, " sensor"]


def evaluate_free_run(
    description: Description, fit: Fit, trials: Sequence[Trial]
) -> FreeRunResult:
    """Simulate a fitted model on records, and compute its relative errors."""
    runs = free_runs(fit, trials)
    return FreeRunResult(description, runs, relative_errors(trials, runs))

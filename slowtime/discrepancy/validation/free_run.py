"""Models and records in; how far free runs are from what was measured, out."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.calibration import (
    Fit,
    first_swings,
    refit,
    size_of,
    state_from_many,
    state_heard,
)
from slowtime.discrepancy.diagnosis import Spectra, Traces
from slowtime.discrepancy.noise import Noise, noise_of_residual
from slowtime.discrepancy.records import FEWEST, Trial
from slowtime.dynamics.description import Description
from slowtime.dynamics.plant import Plant
from slowtime.signals.spectra import transform

START = 0.2
"""Share of a record from which its initial state is taken."""
LOST = 30.0
"""Mean square over the noise, of the first samples, of a run that began in the wrong swing."""
POINTS = 400
"""Of spectra, for pictures."""

Series = Float[np.ndarray, "time sensor"]


def judged(trials: tuple[Trial, ...], holdout: tuple[Trial, ...]) -> tuple[Trial, ...]:
    """Give the records to judge by: those held out, or the last third of each."""
    return holdout or tuple(tail_of(trial) for trial in trials)


def tail_of(trial: Trial) -> Trial:
    """Last third of a record; all of one that is too short for that, as a piece may be."""
    begun = len(trial.outputs) * 2 // 3
    if len(trial.outputs) - begun < FEWEST:
        return trial
    return trial.part(begun, len(trial.outputs))


def on_heads(fit: Fit, trials: Sequence[Trial]) -> Fit:
    """Fit the same model to all but the tails of records; leave it where that cannot be."""
    ends = [len(trial.outputs) * 2 // 3 for trial in trials]
    if min(ends) < FEWEST:
        return fit
    heads = [trial.part(0, end) for trial, end in zip(trials, ends, strict=True)]
    states = fit.states if len(fit.states) == len(heads) else None
    try:
        found = refit(
            fit.plant, heads, noise=fit.noise if states else None, values=fit.values,
            states=states, horizons=(1.0,),
        )  # fmt: skip
    except (np.linalg.LinAlgError, FloatingPointError):
        return fit
    return found if math.isfinite(found.cost) else fit


def free_runs(fit: Fit, trials: Sequence[Trial]) -> list[Series]:
    """Run the model of a fit; initial states are those that the first samples say."""
    runs = []
    for trial in trials:
        state = _begun(fit, _first_of(trial), _noise_of(fit))
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


def on_another(fit: Fit, trial: Trial) -> Fit | None:
    """Fit the same model to another record, from where it is; None where that cannot be.

    That has noise of its own.
    """
    state = _begun(fit, _first_of(trial), _noise_of(fit))
    try:
        return refit(fit.plant, (trial,), values=fit.values, states=[state], horizons=(1.0,))
    except (np.linalg.LinAlgError, FloatingPointError):
        return None


def _first_of(trial: Trial) -> Trial:
    return trial.part(0, max(int(START * len(trial.outputs)), 64))


def _noise_of(fit: Fit) -> Noise:
    """Take the noise of the first record that was fitted for that of others."""
    drift = fit.noise.drift
    first = None if drift is None else drift.first()
    return dataclasses.replace(fit.noise.of([0]), drift=first)


def _begun(fit: Fit, part: Trial, noise: Noise) -> Float[np.ndarray, " state"]:
    """Give the initial state that explains the first samples best.

    What sticks tells nothing of the speed it would have: where there are effects, one begins
    from the state without them too.
    """
    plant, values = fit.plant, fit.values
    bare = Plant.of(dataclasses.replace(plant.description, effects=()), kinds=plant.kinds)
    known = dict(zip(plant.parameters, values.tolist(), strict=True))
    own = np.array([known[name] for name in bare.parameters])
    straight = _settled(bare, part, noise, own, None)
    found = [straight]
    if plant.effects:
        state = (
            {}
            if straight is None
            else dict(zip(bare.state_names, straight.states[0].tolist(), strict=False))
        )
        begun = np.array([state.get(name, 0.0) for name in plant.state_names])
        heard = state_heard(plant, part, begun)
        starts = [None, [begun], *([] if np.array_equal(heard, begun) else [[heard]])]
        found = [_settled(plant, part, noise, values, start) for start in starts]
    ended = [one for one in found if one is not None]
    if not ended:
        return np.zeros(len(plant.state_names))
    best = min(ended, key=lambda one: one.cost)
    if plant.effects and best.cost > LOST * best.data:
        best = _from_elsewhere(best, part)
    return best.states[0]


def _from_elsewhere(fit: Fit, part: Trial) -> Fit:
    """Look farther for an initial state, over the first swings; the better of both."""
    (first,) = first_swings(fit.plant, (part,))
    size = size_of(fit.plant, part, fit.values, fit.states[0])
    state = state_from_many(fit.plant, first, fit.noise, fit.values, fit.states[0], size)
    other = _settled(fit.plant, part, fit.noise, fit.values, (state,))
    return other if other is not None and other.cost < fit.cost else fit


def _settled(
    plant: Plant,
    part: Trial,
    noise: Noise,
    values: Float[np.ndarray, " parameter"],
    states: Sequence[Float[np.ndarray, " state"]] | None,
) -> Fit | None:
    """Fit initial states alone; None where the motion grows beyond bounds from any.

    A law may hold what would run away without it.
    """
    try:
        return refit(
            plant, (part,), free=[], noise=noise, values=values, states=states, horizons=(1.0,)
        )
    except FloatingPointError:
        return None


def errors(trials: Sequence[Trial], runs: Sequence[Series]) -> Float[np.ndarray, " sensor"]:
    """Error of free runs over the scatter of the measurement, by sensor."""
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


def noise_on(fit: Fit, trials: tuple[Trial, ...], runs: Sequence[Series]) -> Noise:
    """Hear the noise of records that were not fitted, from what free runs leave of them."""
    left = tuple(
        np.where(trial.used & np.isfinite(run), trial.measured - run, 0.0)
        for trial, run in zip(trials, runs, strict=True)
    )
    return noise_of_residual(trials, left, silent_above_hz=fit.silent_above_hz)


def floor_of(trials: Sequence[Trial], noise: Noise) -> float:
    """Error that the sensors' noise alone would make; `noise` is that of these trials."""
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
    """Give records, measured and run."""
    return tuple(
        Traces(t.times_s, t.outputs, a, b, c)
        for t, a, b, c in zip(trials, nominal, refits, last, strict=True)
    )


def spectra_of(
    trials: Sequence[Trial], before: list[Series], after: list[Series], noise: Noise
) -> Spectra:
    """Densities, the mean over records, on one grid: no finer than the shortest can tell."""
    top = max(trial.rate_hz for trial in trials) / 2
    finest = min(int(len(trial.outputs) * top / trial.rate_hz) for trial in trials)
    points = int(np.clip(finest // 2, 1, POINTS))
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
class Judged:
    """Free runs of one model, with the errors that they make."""

    description: Description
    runs: list[Series]
    error: Float[np.ndarray, " sensor"]


def judge(description: Description, fit: Fit, trials: Sequence[Trial]) -> Judged:
    """Run a fitted model on the records to judge by."""
    runs = free_runs(fit, trials)
    return Judged(description, runs, errors(trials, runs))

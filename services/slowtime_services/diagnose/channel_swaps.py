"""Detection of sensors or inputs of one quantity that were exchanged.

Sizes do not tell two accelerometers apart. But if third-octave powers are nearer to the model's
with two sensors exchanged, and the model, refitted within its tolerances, then explains the
record several times as well, it is the wires: no effect within a structure exchanges sensors.
Of inputs, what the model does under them tells which to look at.
"""

import dataclasses
import itertools

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.dynamics.description import Description
from slowtime.dynamics.plant import Plant
from slowtime.signals.spectra import detrended, periodogram
from slowtime_services.files import RecordError

MAX_SENSOR_MISFIT_RATIO, MAX_INPUT_MISFIT_RATIO = 0.25, 0.4
"""Share of what is left unexplained that an exchange of sensors, and of inputs, may leave, to
be told of: what is missing from the model is left by both."""
BAND_RATIO = 2 ** (1 / 3)
"""Ratio of the edges of a third-octave band [1]."""
MIN_BAND_POWER = 1e-4
"""Power of a band over the greatest of its sensor [1], below which the band is left out."""


def refuse_swaps(campaign: Campaign, plant: Plant, name: str, cure: str) -> None:
    """Refuse a campaign whose first record indicates that two channels of a kind are exchanged.

    Parameters
    ----------
    name
        What to call that record.
    cure
        What to do where it is as it should be.
    """
    trial = min(campaign.trials, key=lambda one: len(one.outputs)).trimmed()
    if not trial.used.any(axis=0).all():
        return
    made = plant.simulate(plant.values, trial.inputs, trial.rate_hz)
    sensors = likely_pair(campaign.description, trial, made)
    inputs = likely_inputs(plant, trial, made)
    if sensors is None and inputs is None:
        return
    tried: list[tuple[float, float, str, str]] = []
    if sensors is not None:
        one, two = (campaign.description.sensors[i].channel for i in sensors)
        left = _unexplained(plant, _exchanged(trial, *sensors))
        tried.append((left, MAX_SENSOR_MISFIT_RATIO, one, two))
    if inputs is not None:
        one, two = (campaign.description.inputs[i].channel for i in inputs)
        left = _unexplained(plant, _crossed(trial, *inputs))
        tried.append((left, MAX_INPUT_MISFIT_RATIO, one, two))
    before = _unexplained(plant, trial)
    after, share, one, two = min(tried)
    if after <= share * before:
        raise RecordError(
            f"{name}: {one} and {two} appear to be exchanged: refitted within its "
            "tolerances, the "
            f"model leaves {before:.0%} of the record unexplained, and {after:.2g} of it with "
            f"these two exchanged. Give --channel {one}={two} --channel {two}={one}. {cure}"
        )


def likely_inputs(
    plant: Plant, trial: Trial, made: Float[np.ndarray, "time sensor"]
) -> tuple[int, int] | None:
    """Return two inputs of a kind which, exchanged, let the model explain more.

    Parameters
    ----------
    made
        What it does under the inputs as they are.
    """
    inputs = plant.description.inputs
    best, least = None, _missed(trial, made)
    for i, j in itertools.combinations(range(len(inputs)), 2):
        if inputs[i].kind != inputs[j].kind or inputs[i].node == inputs[j].node:
            continue
        crossed = _crossed(trial, i, j)
        missed = _missed(trial, plant.simulate(plant.values, crossed.inputs, trial.rate_hz))
        if missed < least:
            best, least = (i, j), missed
    return best


def likely_pair(
    description: Description, trial: Trial, made: Float[np.ndarray, "time sensor"]
) -> tuple[int, int] | None:
    """Return two sensors of a kind whose powers are nearer to the model's if exchanged.

    Parameters
    ----------
    description
        Model with its sensors.
    trial
        Measured record.
    made
        Outputs of the model, [time, sensor], in SI units.

    Returns
    -------
    Indices of the two sensors, or None if no exchange brings them nearer.
    """
    sensors = description.sensors
    pairs = [
        (i, j)
        for i, j in itertools.combinations(range(len(sensors)), 2)
        if sensors[i].quantity == sensors[j].quantity and sensors[i].node != sensors[j].node
    ]
    if not pairs or not np.isfinite(made).all():
        return None
    apart = _power_distances(trial, made)
    best = min(pairs, key=lambda pair: _gain(apart, *pair))
    return best if _gain(apart, *best) < 0 else None


def _gain(apart: Float[np.ndarray, "sensor sensor"], i: int, j: int) -> float:
    """Return how much further from the model two sensors are when exchanged."""
    return float(apart[i, j] + apart[j, i] - apart[i, i] - apart[j, j])


def _power_distances(
    trial: Trial, made: Float[np.ndarray, "time sensor"]
) -> Float[np.ndarray, "sensor sensor"]:
    """Compare powers: mean squared logarithm of those of the model over the measured ones."""
    one, two = _powers(made, trial.rate_hz), _powers(trial.measured, trial.rate_hz)
    heard = (one > MIN_BAND_POWER * one.max(axis=0)) | (two > MIN_BAND_POWER * two.max(axis=0))
    heard = heard.any(axis=1)
    logs = np.log(one[heard])[:, :, None] - np.log(two[heard])[:, None, :]
    return np.asarray(np.mean(logs**2, axis=0))


def _powers(
    series: Float[np.ndarray, "time sensor"], rate_hz: float
) -> Float[np.ndarray, "band sensor"]:
    spectrum = periodogram(detrended(series), rate_hz)
    frequency = spectrum.frequency_hz
    top, low = float(frequency[-1]), 4 * float(frequency[1])
    edges = low * BAND_RATIO ** np.arange(int(np.log(top / low) / np.log(BAND_RATIO)) + 1)
    first = np.searchsorted(frequency, edges)
    power = np.add.reduceat(spectrum.density, np.unique(first[first < len(frequency)]), axis=0)
    return np.asarray(np.maximum(power, 1e-12 * power.max(axis=0) + 1e-300))


def _exchanged(trial: Trial, i: int, j: int) -> Trial:
    return dataclasses.replace(trial, outputs=_swapped(trial.outputs, i, j))


def _crossed(trial: Trial, i: int, j: int) -> Trial:
    return dataclasses.replace(trial, inputs=_swapped(trial.inputs, i, j))


def _swapped(
    series: Float[np.ndarray, "time channel"], i: int, j: int
) -> Float[np.ndarray, "time channel"]:
    other = series.copy()
    other[:, [i, j]] = series[:, [j, i]]
    return other


def _missed(trial: Trial, made: Float[np.ndarray, "time sensor"]) -> float:
    """Power of the residual of a run over the measured one, mean over sensors; nan for none."""
    with np.errstate(all="ignore"):
        left = np.mean((trial.measured - made) ** 2, axis=0) / np.var(trial.measured, axis=0)
    return float(np.mean(left))


def _unexplained(plant: Plant, trial: Trial) -> float:
    """Power of the refitted model's residual over the measured one, mean over sensors."""
    left = refit(plant, (trial,)).residual[0]
    return float(np.mean(np.mean(left**2, axis=0) / np.var(trial.measured, axis=0)))

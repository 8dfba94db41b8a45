"""A short record whose run may begin in many ways, in; the initial state that explains it, out.

In a strong law the misfit of a few swings has several minima in the initial state, though all
constants are known. So it is looked for from many states.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.noise import Noise
from slowtime.discrepancy.records import MIN_SAMPLES, Trial
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.plant.sensing import sensor_readouts

from .fit import Fit, refit
from .spectral_weights import spectral_weights

STARTS = 48
"""[1] Random initial states that are tried. Source: judgement; no study is recorded."""
START_SPREADS = (1.0, 2.0, 4.0)
"""[root mean squares of the motion] Spreads of the random initial states, in turn. Source:
judgement; no study is recorded."""
MULTISTART_HORIZONS = (0.1, 0.3, 1.0)
"""[share of the record] Fitted one after the other from each random state. Source:
judgement; no study is recorded."""
BEGINNING_SHARE = 0.2
"""[share of the first periods] From which initial states are estimated. Source: judgement;
no study is recorded."""

State = Float[np.ndarray, " state"]


def multistart_initial_state(
    plant: Plant,
    trial: Trial,
    noise: Noise,
    values: Float[np.ndarray, " parameter"],
    known: State,
    size: State,
) -> State:
    """Give the initial state from which a record is explained best, all constants held.

    Parameters
    ----------
    noise
        Of this record alone.
    known
        To be bettered.
    size
        Of the motion, in each coordinate: how far from rest one looks.
    """
    heard = state_from_sensors(plant, trial, known)
    drawn = np.random.default_rng(0).standard_normal((STARTS, len(known)))
    wide = np.resize(START_SPREADS, STARTS)[:, None]
    best, least = known, math.inf
    for number, start in enumerate([known, heard, *(wide * size * drawn)]):
        try:
            told = refit(
                plant, (trial,), free=[], noise=noise, values=values, states=(start,),
                horizons=MULTISTART_HORIZONS if number else (1.0,),
            )  # fmt: skip
        except (np.linalg.LinAlgError, FloatingPointError):
            continue
        if told.cost < least:
            best, least = told.states[0] if number else known, told.cost
    return best


def motion_amplitude(
    plant: Plant, trial: Trial, values: Float[np.ndarray, " parameter"], state: State
) -> State:
    """Give how far from rest a motion goes in each coordinate; from one initial state."""
    run = plant.run(
        values, trial.inputs, trial.rate_hz, state0=state, start_s=trial.start_s
    ).states
    moved = np.sqrt(np.mean(np.square(run), axis=0))
    return np.asarray(np.fmax(np.abs(state), np.where(np.isfinite(moved), moved, 0.0)))


def state_from_sensors(plant: Plant, trial: Trial, known: State) -> State:
    """Give a state in which what sensors say of displacement and velocity takes its place."""
    described = plant.description
    moves = any(entry.kind == "base_acceleration" for entry in described.inputs)
    coordinates = len(plant.matrices.names)
    found = known.copy()
    ears = sensor_readouts(described, plant.matrices.names)
    for ear, value, used in zip(ears, trial.outputs[0], trial.used[0], strict=True):
        if ear.coordinate is None or ear.order > 1 or not used or (ear.absolute and moves):
            continue
        found[ear.order * coordinates + ear.coordinate] = value / ear.factor
    return found


def best_initial_state(
    plant: Plant,
    trial: Trial,
    noise: Noise,
    values: Float[np.ndarray, " parameter"],
    states: Sequence[State],
) -> State:
    """Give the one of several initial states whose free run comes nearest; the first of equals.

    Parameters
    ----------
    noise
        Of this record alone.
    """
    weights = spectral_weights(trial, noise, 0)

    def left(state: State) -> float:
        run = plant.simulate(
            values, trial.inputs, trial.rate_hz, state0=state, start_s=trial.start_s
        )
        chi2 = weights.chi2(trial.measured - run)
        return chi2 if math.isfinite(chi2) else math.inf

    return min(states, key=left)


def refit_initial_states(before: Fit, heads: Sequence[Trial]) -> Fit:
    """Give a fit the initial states that the first samples say, whatever comes after them.

    Those of a whole record make up for what the model lacks in all of it.
    """
    counts = [max(int(BEGINNING_SHARE * len(head.outputs)), MIN_SAMPLES) for head in heads]
    parts = [head.part(0, count) for head, count in zip(heads, counts, strict=True)]
    first = refit(
        before.plant, parts, noise=before.noise, values=before.values, horizons=(1.0,)
    )
    return dataclasses.replace(before, states=first.states)

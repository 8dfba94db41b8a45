"""Initial states of records: read off sensors, fitted, and found by multistart.

With a strongly nonlinear law the misfit of a few periods has several minima in the initial
state, though all constants are known. A multistart finds the lowest of them.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.noise import Noise
from slowtime.discrepancy.records import MIN_SAMPLES, Trial
from slowtime.discrepancy.time_limit import leave_out
from slowtime.dynamics.channels import BASE_KINDS
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.plant.sensing import sensor_readouts

from .fit import Fit, refit, try_refit
from .spectral_weights import spectral_weights

STARTS = 48
"""[1] Random initial states that are tried. Source: docs/what_decides.md: half and double
change no answer."""
START_SPREADS = (1.0, 2.0, 4.0)
"""[root mean squares of the motion] Spreads of the random initial states, in turn. Source:
docs/what_decides.md: half and double change no answer."""
MULTISTART_HORIZONS = (0.1, 0.3, 1.0)
"""[share of the record] Fitted one after the other from each random state. Source:
docs/what_decides.md: half and double change no answer."""
BEGINNING_SHARE = 0.2
"""[share of the first periods] From which initial states are estimated. Source:
docs/what_decides.md: half and double change no answer."""

State = Float[np.ndarray, " state"]


def multistart_initial_state(
    plant: Plant,
    trial: Trial,
    noise: Noise,
    values: Float[np.ndarray, " parameter"],
    known: State,
    size: State,
) -> State:
    """Find the initial state of least cost from many random ones, all constants held."""
    heard = state_from_sensors(plant, trial, known)
    drawn = np.random.default_rng(0).standard_normal((STARTS, len(known)))
    wide = np.resize(START_SPREADS, STARTS)[:, None]
    best, least = known, math.inf
    for number, start in enumerate([known, heard, *(wide * size * drawn)]):
        if number and leave_out("a multistart of initial states"):
            break
        told = try_refit(
            plant, (trial,), free=[], noise=noise, values=values, states=(start,),
            horizons=MULTISTART_HORIZONS if number else (1.0,),
        )  # fmt: skip
        if told is not None and told.cost < least:
            best, least = told.states[0] if number else known, told.cost
    return best


def motion_amplitude(
    plant: Plant, trial: Trial, values: Float[np.ndarray, " parameter"], state: State
) -> State:
    """Amplitude of a free run in each coordinate: root mean square, or a larger start."""
    run = plant.run(
        values, trial.inputs, trial.rate_hz, state0=state, start_s=trial.start_s
    ).states
    moved = np.sqrt(np.mean(np.square(run), axis=0))
    return np.asarray(np.fmax(np.abs(state), np.where(np.isfinite(moved), moved, 0.0)))


def state_from_sensors(plant: Plant, trial: Trial, known: State) -> State:
    """Replace displacements and velocities of a state by the first readings of sensors."""
    described = plant.description
    moves = any(entry.kind in BASE_KINDS for entry in described.inputs)
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
    """Choose the initial state whose free run has the least chi squared."""
    weights = spectral_weights(trial, noise, 0)

    def left(state: State) -> float:
        run = plant.simulate(
            values, trial.inputs, trial.rate_hz, state0=state, start_s=trial.start_s
        )
        chi2 = weights.chi2(trial.measured - run)
        return chi2 if math.isfinite(chi2) else math.inf

    return min(states, key=left)


def refit_initial_states(before: Fit, heads: Sequence[Trial]) -> Fit:
    """Refit the initial states of a fit to the first samples alone."""
    # Initial states of a whole record make up for what the model lacks in all of it.
    counts = [max(int(BEGINNING_SHARE * len(head.outputs)), MIN_SAMPLES) for head in heads]
    parts = [head.part(0, count) for head, count in zip(heads, counts, strict=True)]
    first = refit(
        before.plant, parts, noise=before.noise, values=before.values, horizons=(1.0,)
    )
    return dataclasses.replace(before, states=first.states)

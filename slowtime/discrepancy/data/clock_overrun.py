"""Masks of samples that a fast sensor clock took after the end of the record.

A run ends with its inputs, so that no model can predict what such a sensor read after them.
"""

import dataclasses
from collections.abc import Iterable, Mapping

import numpy as np
from jaxtyping import Bool, Float

from slowtime.discrepancy.records import Trial
from slowtime.dynamics.effects import Effect, Kind, SensorChange

OVERRUN_MARGIN = 1.1
"""[1] Times the overrun of a first guess of the clock that is masked, as the guess may be low.
Source: docs/what_decides.md: half and double change no answer."""
INTERPOLATION_SAMPLES = 8
"""[samples] On either side from which a value between samples is interpolated. Source: reach
of the interpolation in `slowtime.signals`."""


def mask_clock_overrun(
    trials: tuple[Trial, ...],
    channels: tuple[str, ...],
    effects: Iterable[Effect],
    kinds: Mapping[str, Kind],
) -> tuple[Trial, ...]:
    """Mask samples that effects on sensor clocks take from beyond the record."""
    found = list(trials)
    for effect in effects:
        kind = kinds[effect.kind]
        if not isinstance(kind.action, SensorChange):
            continue
        values = kind.values(effect.parameters)
        column = channels.index(effect.place.id)
        for i, trial in enumerate(found):
            late = clock_overrun(kind.action, trial, values)
            if late.any():
                use = trial.used.copy()
                use[late, column] = False
                found[i] = dataclasses.replace(trial, use=use)
    return tuple(found)


def clock_overrun(
    action: SensorChange, trial: Trial, values: Float[np.ndarray, " parameter"]
) -> Bool[np.ndarray, " time"]:
    """Mask samples that a change of the clock takes from after the last one of the record."""
    times = trial.times_s
    ramp = times - times[0]
    late = np.zeros(len(times), dtype=bool)
    # A change of the clock leaves a constant series as it is, and a ramp not.
    told = action.act(np.ones(len(times)), times, values)
    if not np.allclose(told, 1.0, rtol=0, atol=1e-3):
        return late
    late = action.act(ramp, times, values) > ramp[-1] * (1 + 1e-12)
    if late.any():
        count = int(OVERRUN_MARGIN * late.sum()) + INTERPOLATION_SAMPLES
        late[-count:] = True
    return np.asarray(late)

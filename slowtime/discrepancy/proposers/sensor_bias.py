"""Recognition of an accelerometer with an offset that no structure could cause.

A structure that is held has no lasting acceleration: over a record its mean is what speed has
gained, by the time. What an accelerometer tells beyond that is its own, however much else is
missing; and with that in the way, how records begin tells of nothing.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import Fit, lowest_frequency_hz
from slowtime.discrepancy.candidates.force_space import ForceSpace
from slowtime.discrepancy.candidates.parameter_scan import best_effect
from slowtime.discrepancy.estimation.candidate_fit import FitSchedule, fit_candidate
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate
from slowtime.discrepancy.localization import Localization
from slowtime.discrepancy.noise import has_rigid_motion
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.effects import Kind, Place
from slowtime.signals.spectra import transform

KINDS = ("sensor_bias", "sensor_drift")
WHOLE_RECORDS = FitSchedule(horizons=(1.0,))
"""An error of a sensor does not change the motion, so that no horizon has to grow."""
QUASI_STATIC_RATIO = 0.3
"""[lowest natural frequency] Below which a structure follows slow forces without vibrating.
Source: the dynamic amplification 1 / (1 - 0.3²) is 1.1 there."""
MIN_SLOW_LINES = 3
"""[spectral lines] Of a record that must lie below for an error to be judged. Source:
docs/what_decides.md: half and double change no answer."""
MIN_MEAN_POWER = 100.0
"""[mean power of the slow lines] Of the mean of a residual, from which the accelerometer has a
steady error. Source: docs/what_decides.md: half and double change no answer."""
MAX_MEAN_POWER = 10.0
"""[mean power of the slow lines] The same, up to which a law of the sensor has removed the
error. Source: docs/what_decides.md: half and double change no answer."""


def biased_accelerometer(fit: Fit, trials: Sequence[Trial]) -> Place | None:
    """Say which accelerometer stands off the most, if one does."""
    if len(fit.states) != len(trials) or has_rigid_motion(fit.plant.description):
        return None
    heights = [_height(fit, trials, i) for i in range(len(fit.plant.description.sensors))]
    best = int(np.argmax(heights))
    if heights[best] < MIN_MEAN_POWER:
        return None
    return Place("sensor", fit.plant.description.sensors[best].channel)


def sensor_bias_candidate(
    before: Fit,
    place: Place,
    located: Localization,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
) -> FittedCandidate | None:
    """Refit a constant error or a drift there; None where it stands off all the same."""
    space = ForceSpace(before, located, place)
    laws = [best_effect(kinds[name], space) for name in KINDS if name in kinds]
    every = [
        fit_candidate(before, law[0], trials, kinds, None, schedule=WHOLE_RECORDS)
        for law in laws
        if law
    ]
    channels = [sensor.channel for sensor in before.plant.description.sensors]
    at = channels.index(place.id)
    heights = [(_height(one.fit, trials, at), i) for i, one in enumerate(every) if one]
    least, best = min(heights, default=(math.inf, -1))
    return every[best] if least < MAX_MEAN_POWER else None


def _height(fit: Fit, trials: Sequence[Trial], sensor: int) -> float:
    """Power of the mean over that of the slow lines beside it, where it is most."""
    if fit.plant.description.sensors[sensor].quantity != "acceleration":
        return 0.0
    lowest = lowest_frequency_hz(fit.plant)
    found = 0.0
    for residual, trial in zip(fit.residual, trials, strict=True):
        if not trial.used[:, sensor].all() or not lowest:
            continue
        frequency, spectrum = transform(residual[:, [sensor]], trial.rate_hz)
        power = np.abs(spectrum[:, 0]) ** 2
        slow = power[1:][frequency[1:] < QUASI_STATIC_RATIO * lowest]
        if len(slow) >= MIN_SLOW_LINES:
            found = max(found, float(power[0] / max(slow.mean(), 1e-300)))
    return found

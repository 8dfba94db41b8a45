"""Free decays: records that nothing drives, which die down and may end at a standstill."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.records import MIN_SAMPLES, Trial
from slowtime.dynamics.effects import Kind

MIN_REST = 0.02
"""[share of a record] At rest at its end, from which that is cut off. Source: a decision."""
STILL_STEPS = 2.5
"""[steps of the sensor] From its last readings, within which a channel is at rest: what it
tells there is its resolution. Source: judgement; half a step more than two."""
REST_READINGS = 50
"""[1] Part of a record whose median tells where it comes to rest: one of this many. Source: the
share `MIN_REST` at rest from which a record is cut."""
MIN_PEAKS = 8
"""[half cycles] That a record must hold. Source: peaks of random motion fall eight times in a
row in one record of forty thousand."""
MAX_RISING_SHARE = 0.05
"""[share of the peaks] That may be higher than one cycle before. Source: the 5 % level; those
of stationary random motion rise half of the time."""
MIN_RISE = 0.005
"""[share of the largest peak] By which a peak must be higher to have risen. Source: resolution
of usual encoders and the noise of usual sensors."""
MIN_FALL = 0.8
"""[1] Of the last peaks to the first, at most. Source: a decision; less tells no damping."""


def is_free_decay(trials: Sequence[Trial]) -> bool:
    """Return whether nothing drives any record, and each dies down from peak to peak.

    Parameters
    ----------
    trials
        Records without inputs, or with inputs.
    """
    return bool(trials) and all(not one.inputs.any() and _decays(one) for one in trials)


def without_standstill(trial: Trial) -> Trial:
    """Cut a free decay where it has come to rest: a still channel is not a faulty one there.

    Parameters
    ----------
    trial
        Record of a free decay.

    Returns
    -------
    The record up to its last change, or as it is where hardly any of it is at rest.
    """
    moving = np.flatnonzero((np.abs(_excursions(trial.measured)) > STILL_STEPS).any(axis=1))
    end = int(moving[-1]) + 2 if len(moving) else len(trial.outputs)
    resting = len(trial.outputs) - end
    if resting < MIN_REST * len(trial.outputs) or end < MIN_SAMPLES:
        return trial
    return trial.part(0, end)


def without_tones(kinds: Mapping[str, Kind]) -> dict[str, Kind]:
    """List the kinds that need no drive of their own.

    A tone or a pulsation at the frequency of the decay follows it for as long as it lasts, and
    imitates any law of its damping.
    """
    return {name: kind for name, kind in kinds.items() if kind.quadrature is None}


def _excursions(series: Float[np.ndarray, "time sensor"]) -> Float[np.ndarray, "time sensor"]:
    """Distances from the last readings, in the least steps between readings that differ."""
    found = np.zeros(series.shape)
    for sensor, column in enumerate(series.T):
        steps = np.abs(np.diff(column))
        least = steps[steps > 0].min(initial=np.inf)
        rest = np.median(column[-max(len(column) // REST_READINGS, 1) :])
        found[:, sensor] = (column - rest) / least if np.isfinite(least) else 0.0
    return found


def _decays(trial: Trial) -> bool:
    """Whether the peaks of the loudest sensor of a record fall from cycle to cycle."""
    loud = int(np.argmax(np.std(trial.measured, axis=0)))
    series = trial.measured[:, loud]
    peaks = _peaks(series - np.mean(series[len(series) // 2 :]))
    if len(peaks) < MIN_PEAKS:
        return False
    rising = np.mean(peaks[2:] > peaks[:-2] + MIN_RISE * peaks.max())
    return bool(rising < MAX_RISING_SHARE and peaks[-2:].mean() < MIN_FALL * peaks[:2].mean())


def _peaks(series: Float[np.ndarray, " time"]) -> Float[np.ndarray, " peak"]:
    """Largest sizes between crossings of zero; the first and last piece are left out."""
    ends = np.flatnonzero(np.diff(np.signbit(series))) + 1
    pieces = np.split(np.abs(series), ends)[1:-1]
    return np.array([float(piece.max()) for piece in pieces])

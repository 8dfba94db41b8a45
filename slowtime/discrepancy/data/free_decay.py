"""Detection of free decays among records without measured inputs."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.records import Trial

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
    """Return whether every record dies down from peak to peak, as nothing that is driven does.

    Parameters
    ----------
    trials
        Records without inputs.
    """
    return bool(trials) and all(_decays(trial) for trial in trials)


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

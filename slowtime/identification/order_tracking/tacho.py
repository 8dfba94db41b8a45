"""Shaft angle and speed from the pulses of a tacho."""

import dataclasses

import numpy as np
import scipy
from jaxtyping import Float

HYSTERESIS = 0.2
"""[range of the tacho] Between the levels of a rising and of a falling edge, so that noise on
an edge is not counted as pulses."""

JUMP = 1.6
"""[interval before] Longest or (inverse) shortest interval between pulses of a machine: beyond,
pulses were missed or added. Source: a missed pulse makes 2; no shaft changes its speed by half
within one pulse."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rotation:
    """Angle of a shaft over time.

    Parameters
    ----------
    time_s
        Of the pulses [s].
    revolutions
        Turned since the first of them.
    """

    time_s: Float[np.ndarray, " pulse"]
    revolutions: Float[np.ndarray, " pulse"]

    def times(self, revolutions: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """Instants of angles.

        Parameters
        ----------
        revolutions
            Angles within the record, ascending [revolutions].

        Returns
        -------
        Instants [s].
        """
        return np.asarray(
            scipy.interpolate.CubicSpline(self.revolutions, self.time_s)(revolutions)
        )

    def speed_hz(self, time_s: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """Speed of the shaft.

        Parameters
        ----------
        time_s
            Instants [s].

        Returns
        -------
        Revolutions per second [Hz].
        """
        return np.asarray(
            scipy.interpolate.CubicSpline(self.time_s, self.revolutions)(time_s, 1)
        )


def rotation_of(
    tacho: Float[np.ndarray, " time"], rate_hz: float, *, pulses_per_revolution: int = 1
) -> Rotation:
    """Read the angle of a shaft off a tacho signal.

    Parameters
    ----------
    tacho
        Samples of pulses, of any level.
    rate_hz
        Sampling rate [Hz].
    pulses_per_revolution
        Marks on the shaft.

    Returns
    -------
    Angle over time.

    Raises
    ------
    ValueError
        Where there are fewer than four pulses, or pulses were missed.
    """
    if pulses_per_revolution < 1:
        raise ValueError(
            f"{pulses_per_revolution=} is not a valid number of marks. Give 1 or more."
        )
    low, high = np.quantile(tacho, [0.001, 0.999])
    upper = low + (0.5 + HYSTERESIS / 2) * (high - low)
    lower = low + (0.5 - HYSTERESIS / 2) * (high - low)
    rises = _rises(tacho, lower, upper)
    if len(rises) < 4:
        raise ValueError(
            f"{len(rises)} pulses were found in {len(tacho) / rate_hz:.4g} s of tacho, at "
            "least 4 are needed. Give the channel of the tacho, with one pulse for each mark."
        )
    before, after = tacho[rises - 1], tacho[rises]
    time = (rises - 1 + (upper - before) / (after - before)) / rate_hz
    intervals = np.diff(time)
    longer = np.maximum(intervals[1:], intervals[:-1])
    shorter = np.minimum(intervals[1:], intervals[:-1])
    # An edge of few samples may seem to be one sample early or late.
    ratio = (longer - 1 / rate_hz) / (shorter + 1 / rate_hz)
    if ratio.max() > JUMP:
        at = time[int(np.argmax(ratio)) + 1]
        raise ValueError(
            f"The interval between pulses changes by a factor {ratio.max():.2f} at {at:.4g} s: "
            "a pulse was missed or added. Check the tacho, or cut the record there."
        )
    return Rotation(time_s=time, revolutions=np.arange(len(time)) / pulses_per_revolution)


def _rises(tacho: np.ndarray, lower: float, upper: float) -> np.ndarray:
    """Find rises above the upper level, after the signal was below the lower."""
    state = np.where(tacho > upper, 1, np.where(tacho < lower, -1, 0))
    known = np.flatnonzero(state)
    kept = state[known]
    at = known[1:][(kept[1:] == 1) & (kept[:-1] == -1)]
    # Between both levels there may be samples: the edge is at the first above the upper.
    return np.asarray(at)

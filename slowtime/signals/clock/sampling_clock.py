"""True sampling rate and time axis from the arrival times of messages.

A device that promises 200 Hz samples at 200 Hz times one plus its own error, and every
frequency read from its samples is wrong by that error. The host's clock shows it: messages
arrive late by an unknown, jittered latency, but over minutes that is small against the time
they span. State is passed, never kept, and bounded: at most some dozens of spans of messages,
each by the lower convex hull of its delays (see `clock_fit`).
"""

import dataclasses
import math
from typing import Literal

import numpy as np
from jaxtyping import Int

from slowtime.signals.block import RateCorrection

from .history import ClockHistory
from .state import ClockState
from .tolerances import ClockTolerances

__all__ = ["ClockReading", "ClockState", "ClockTolerances", "SamplingClock"]


@dataclasses.dataclass(frozen=True, slots=True)
class ClockReading:
    """What is known of a sampling clock.

    Parameters
    ----------
    nominal_rate_hz
        What the device promises.
    correction, correction_sd
        True rate is nominal times one plus `correction`; relative, with standard deviation.
    first_index, first_ns
        A sample, and the host's clock when it was taken.
    time_sd_s
        Standard deviation of `time_ns` at the samples seen so far, common to all of them [s].
    messages, ignored
        Taken in; left out because their index did not rise.
    jitter_s
        Mean lateness of messages beyond the least late ones [s].
    steps, rate_changes
        How often the host's clock stepped, or the rate changed, since `start`.
    flags
        'few': nothing measured yet, the correction is what was assumed.
        'stepped', 'rate_changed': the estimate has begun anew after that.
        'late': messages have been late, or early, for seconds; no cause is established yet.
        'beyond_tolerance': the rate is farther off than the device's tolerance allows.
    """

    nominal_rate_hz: float
    correction: float
    correction_sd: float
    first_index: int
    first_ns: int
    time_sd_s: float
    messages: int
    ignored: int
    jitter_s: float
    steps: int
    rate_changes: int
    flags: tuple[str, ...]

    @property
    def rate_hz(self) -> float:
        """True rate [Hz]."""
        return self.nominal_rate_hz * (1.0 + self.correction)

    @property
    def rate_correction(self) -> RateCorrection:
        """What a `Block` carries of it."""
        return RateCorrection(relative=self.correction, sd=self.correction_sd)

    def time_ns(self, index: int) -> int:
        """Host time when sample `index` was taken [ns since 1970-01-01 UTC]."""
        return self.first_ns + round((index - self.first_index) * 1e9 / self.rate_hz)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class SamplingClock:
    """Estimate a device's sampling rate and time from when its messages arrived.

    Parameters
    ----------
    nominal_rate_hz
        What the device promises, and what its indices are counted in.
    stamps
        'arrival': late, never early, stamped by the host. 'device': stamped by the device's
        own clock, wrong to both sides.
    tolerances
        What is assumed of device, host and network.

    Examples
    --------
    >>> clock = SamplingClock(nominal_rate_hz=100.0)
    >>> index = np.arange(20, 12_000, 20)
    >>> arrival_ns = (index * 1e9 / 100.5).astype(np.int64)  # the device is 0.5 % fast
    >>> reading = clock.read(clock.step(clock.start(), index, arrival_ns))
    >>> round(reading.correction, 6)
    0.005
    """

    nominal_rate_hz: float
    stamps: Literal["arrival", "device"] = "arrival"
    tolerances: ClockTolerances = dataclasses.field(default_factory=ClockTolerances)

    def __post_init__(self) -> None:
        """Refuse a rate that is none."""
        if not (math.isfinite(self.nominal_rate_hz) and self.nominal_rate_hz > 0):
            raise ValueError(
                f"nominal_rate_hz={self.nominal_rate_hz} is not a sampling rate. Give samples "
                "per second, a positive number."
            )

    def start(self) -> ClockState:
        """Begin with nothing seen: at the first message, or where indices begin anew."""
        return ClockState(slope_sd=self.tolerances.rate)

    def step(
        self,
        state: ClockState,
        index: Int[np.ndarray, " message"],
        arrival_ns: Int[np.ndarray, " arrival"],
    ) -> ClockState:
        """Process messages in order of arrival; how they are cut into calls does not matter.

        Parameters
        ----------
        state
            State after the messages before.
        index
            Of the last sample of each message, counting lost samples too. A message whose
            index does not rise is left out.
        arrival_ns
            When each arrived, on the host's clock, or its stamp [ns since 1970-01-01 UTC].

        Returns
        -------
        State after the messages.

        Raises
        ------
        ValueError
            Where the two are not of one length.
        """
        if len(index) != len(arrival_ns):
            raise ValueError(
                f"{len(index)} indices and {len(arrival_ns)} arrival times. Give one of each "
                "per message."
            )
        history = ClockHistory(state, self.nominal_rate_hz, self.stamps, self.tolerances)
        for at, arrived_ns in zip(index.tolist(), arrival_ns.tolist(), strict=True):
            history.take(at, arrived_ns)
        return history.state

    def read(self, state: ClockState) -> ClockReading:
        """Tell what is known so far."""
        given, line = self.tolerances, state.line
        slope, sd, flags = state.posterior()
        correction = 1.0 / (1.0 + slope) - 1.0
        offset_s, offset_sd_s = state.offset(slope)
        latency_s = given.latency_s if self.stamps == "arrival" else 0.0
        latency_sd_s = given.latency_sd_s if self.stamps == "arrival" else 0.0
        flags += tuple(word for word in (state.began,) if word)
        flags += ("late",) if len(state.waiting) > given.notable else ()
        return ClockReading(
            nominal_rate_hz=self.nominal_rate_hz,
            correction=correction,
            correction_sd=math.hypot(sd / (1.0 + slope) ** 2, given.wander),
            first_index=state.first_index,
            first_ns=state.first_arrival_ns + round((offset_s - latency_s) * 1e9),
            time_sd_s=math.hypot(offset_sd_s, latency_sd_s, line.scatter if line else 0.0),
            messages=state.messages,
            ignored=state.ignored,
            jitter_s=state.jitter_s(),
            steps=state.steps,
            rate_changes=state.rate_changes,
            flags=flags,
        )

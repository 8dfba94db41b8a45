"""Estimates the time of each sample and the true rate from arrivals or stamps."""

import numpy as np

from slowtime.signals.clock.sampling_clock import ClockReading, SamplingClock

from .counts import SampleCounts


class Timing:
    """The clock model of one device, fed as samples come, read as blocks leave.

    Parameters
    ----------
    stamps
        Whether it is fed with stamps of a synchronised device clock, or with arrivals.
    """

    def __init__(self, rate_hz: float, *, stamps: bool, tally: SampleCounts) -> None:
        self.rate_hz, self._tally, self._stamps = rate_hz, tally, stamps
        self.begin(rate_hz)

    def begin(self, rate_hz: float) -> None:
        """Begin with nothing seen: the device, or its rate, is another."""
        self.rate_hz = rate_hz
        self._clock = SamplingClock(
            nominal_rate_hz=rate_hz, stamps="device" if self._stamps else "arrival"
        )
        self._state = self._clock.start()
        self._indices: list[int] = []
        self._times_ns: list[int] = []

    def note(self, index: int, time_ns: int) -> None:
        """Take up when a sample came, or was stamped."""
        self._indices.append(index)
        self._times_ns.append(time_ns)

    def read(self) -> ClockReading:
        """Return the clock model as of now."""
        if self._indices:
            self._state = self._clock.step(
                self._state,
                np.array(self._indices, dtype=np.int64),
                np.array(self._times_ns, dtype=np.int64),
            )
            self._indices, self._times_ns = [], []
        reading = self._clock.read(self._state)
        # A counter of Health is never below 0: what is slow is told as a rate of less.
        self._tally.put("sampling_rate_uhz", round(reading.rate_hz * 1e6))
        self._tally.put("sampling_rate_sd_ppm", round(reading.correction_sd * 1e6))
        return reading

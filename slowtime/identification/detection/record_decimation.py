"""Decimation of long records to the sampling rate that a mode needs.

A mode is fitted at many places and lags. At 50 kHz a mode of 8 Hz has six thousand samples a
cycle, of which thirty tell all that there is to know.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.signals.decimation import PASS, Decimated, decimated, moved_down

from .resonance_peaks import PeakCandidate

LONG = 131_072
"""Length up to which a record is used as it is [samples]."""

SAMPLES_PER_CYCLE = 32.0
"""Least sampling rate [samples per cycle of the candidate]."""

FEWEST = 8192
"""Least length after decimation [samples]: the filter then costs under 1 % of the record."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class LongRecord:
    """A record, and what has been made of it at lower rates."""

    columns: Float[np.ndarray, "time channel"]
    rate_hz: float
    _slower: dict[int, Decimated] = dataclasses.field(default_factory=dict)

    def at_rate_for(self, frequency_hz: float, cycles: float = SAMPLES_PER_CYCLE) -> Decimated:
        """Record decimated to no less than `cycles` samples per cycle, if it is long."""
        count = len(self.columns)
        most = min(self.rate_hz / (cycles * frequency_hz), count / FEWEST)
        factor = 1
        while count > LONG and 2 * factor <= most:
            factor *= 2
        if factor not in self._slower:
            self._slower[factor] = decimated(self.columns, self.rate_hz, factor)
        return self._slower[factor]

    def near(self, frequency_hz: float) -> Decimated:
        """Record reduced to a band about a frequency, as the excitation tests need it."""
        slower = self.at_rate_for(frequency_hz)
        if len(slower.samples) <= LONG:
            return slower
        reach = min(LONG / (12 * self.duration_s), 0.5 * frequency_hz)
        parts = [
            moved_down(column, slower.rate_hz, frequency_hz, reach)
            for column in slower.samples.T
        ]
        together = np.concatenate([part.samples for part in parts], axis=1)
        return dataclasses.replace(parts[0], samples=together)

    @property
    def duration_s(self) -> float:
        """Of the record [s]."""
        return len(self.columns) / self.rate_hz

    def about(self, candidate: PeakCandidate) -> tuple[Decimated, PeakCandidate]:
        """Record at the rate that a candidate needs, and the candidate in its band."""
        slower = self.at_rate_for(candidate.frequency_hz)
        if slower.rate_hz == self.rate_hz:
            return slower, candidate
        highest = PASS * slower.rate_hz / 2
        return slower, dataclasses.replace(candidate, high_hz=min(candidate.high_hz, highest))

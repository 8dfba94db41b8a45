"""Records of boards with clocks of their own, and the result of their alignment."""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.identification.estimates import Measured
from slowtime.signals.interpolation import at_instants


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoardRecord:
    """What one board recorded, on its own time axis.

    Parameters
    ----------
    rate_hz, rate_sd
        Samples per second as far as known, and its relative standard deviation [1].
    start_s, start_sd_s
        Time of the first sample on the common axis, and its standard deviation [s].
    """

    samples: Float[np.ndarray, "time channel"]
    channels: tuple[str, ...]
    rate_hz: float
    rate_sd: float = 0.0
    start_s: float = 0.0
    start_sd_s: float = 0.0

    @property
    def end_s(self) -> float:
        """Time of the last sample [s]."""
        return self.start_s + (len(self.samples) - 1) / self.rate_hz

    def at(
        self, times_s: Float[np.ndarray, " instant"]
    ) -> Float[np.ndarray, "instant channel"]:
        """Band-limited interpolation of all channels at times on the board's own axis [s]."""
        positions = (times_s - self.start_s) * self.rate_hz
        columns = np.asarray(self.samples, dtype=float).T
        return np.asarray(at_instants(np.ascontiguousarray(columns), positions).T)

    def moved(self, offset_s: float, drift: float) -> "BoardRecord":
        """Board with a corrected clock.

        The first sample moves by `offset_s`; the rate rises by `drift` [1].
        """
        return dataclasses.replace(
            self, start_s=self.start_s + offset_s, rate_hz=self.rate_hz * (1.0 + drift)
        )


@dataclasses.dataclass(frozen=True, slots=True)
class ModeEvidence:
    """One mode that both boards see, and the phase between them that alignment has left.

    Parameters
    ----------
    coherence
        Between the boards at the mode [1].
    """

    frequency_hz: float
    phase_rad: Measured
    coherence: float


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alignment:
    """Whether two boards could be put on one clock.

    Parameters
    ----------
    merged
        All channels, on the time axis of the board that samples faster; None if not aligned.
    sentence
        What was found, or why the boards stay apart.
    offset_s
        What the second board's stated start lacks, with standard deviation [s].
    drift
        By which its stated rate is to be corrected, relative to the first one's [1].
    evidence
        The modes that it rests on.
    """

    merged: BoardRecord | None
    sentence: str
    offset_s: Measured | None = None
    drift: Measured | None = None
    evidence: tuple[ModeEvidence, ...] = ()

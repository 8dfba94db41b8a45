"""Frames of a stream, moved to the middle of a band and decimated."""

import dataclasses

import numpy as np
import scipy.fft as fft
from jaxtyping import Complex, Float

from slowtime.identification.subspace.bands import EDGE, Passband

FRAME = 24.0
"""A frame lasts so many times as long as the fading edge of its band is narrow [1/Hz]: what the
fading smears beyond a quarter of it, and the ends of the frame into its middle, is 70 dB down.
"""


@dataclasses.dataclass(frozen=True, slots=True)
class BinRange:
    """How a band is cut out of the stream: bins from `first`, `number` of them.

    Frames of `length` samples follow each other by half a frame; of each the middle half of the
    slow series is kept, so that those of successive frames join without a seam.
    """

    band: Passband
    length: int
    first: int
    number: int
    sampling_hz: float

    @staticmethod
    def of(band: Passband, sampling_hz: float) -> "BinRange":
        """Shortest frame that resolves a band and its margin."""
        band = _widened(band, EDGE * sampling_hz / 2)
        edge = min(band.low_hz - band.from_hz, band.to_hz - band.high_hz)
        half = int(np.ceil(FRAME / edge * sampling_hz / 2))
        length = 2 * fft.next_fast_len(half, real=True)
        spacing = sampling_hz / length
        first = int(np.ceil(band.from_hz / spacing))
        last = int(np.floor(band.to_hz / spacing))
        number = fft.next_fast_len(last - first + 1)
        while number % 4:
            number = fft.next_fast_len(number + 1)
        return BinRange(band, length, first, number, sampling_hz)

    @property
    def hop(self) -> int:
        """Samples from one frame to the next."""
        return self.length // 2

    @property
    def hop_s(self) -> float:
        """Seconds from one frame to the next."""
        return self.hop / self.sampling_hz

    @property
    def rate_hz(self) -> float:
        """Of the slow series [Hz]."""
        return self.number * self.sampling_hz / self.length

    @property
    def middle(self) -> int:
        """Bin that is moved to zero."""
        return self.first + self.number // 2

    @property
    def centre_hz(self) -> float:
        """Frequency that is moved to zero [Hz]."""
        return self.middle * self.sampling_hz / self.length

    def moved_to_zero(
        self, samples: Float[np.ndarray, "time channel"], before: int
    ) -> Complex[np.ndarray, "instant channel"]:
        """Demodulated, decimated series of the middle half of a frame.

        Twice its real part, turned back to `centre_hz`, is the band.
        """
        stop = min(self.first + self.number, self.length // 2 + 1)
        index = np.arange(self.first, stop)
        gain = self.band.gain(index * self.sampling_hz / self.length)
        padded = np.zeros((self.number, samples.shape[1]), dtype=complex)
        padded[: len(index)] = fft.rfft(samples, axis=0)[index] * gain[:, None]
        padded = np.roll(padded, -(self.number // 2), axis=0)
        slow = fft.ifft(padded, axis=0) * (self.number / self.length)
        # In half a frame the middle bin turns by so many half turns.
        turn = -1.0 if self.middle * before % 2 else 1.0
        quarter = self.number // 4
        return np.asarray(turn * slow[quarter : 3 * quarter])


def _widened(band: Passband, highest_hz: float) -> Passband:
    """Band that is flat half-way into its edges: modes are told by their skirts as well."""
    skirt = band.low_hz - band.from_hz
    stop = min(band.to_hz + 0.25 * (band.to_hz - band.high_hz), highest_hz)
    return Passband(
        low_hz=band.low_hz - 0.5 * skirt,
        high_hz=max(band.high_hz, stop - 0.75 * skirt),
        from_hz=band.from_hz - 0.25 * skirt,
        to_hz=stop,
    )

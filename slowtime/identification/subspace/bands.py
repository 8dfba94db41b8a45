"""Overlapping frequency bands of a record, each demodulated and decimated.

A mode needs neither the rate of the record nor the company of modes an octave away. In a band
of its own, a few lags reach over its memory and a few states describe it, whatever the rate.
"""

import dataclasses
import itertools

import numpy as np
import scipy.fft as fft
from jaxtyping import Complex, Float

CORE = 1.4
"""Ratio of the edges of a band's core: modes are accepted there."""

MARGIN = 1.35
"""Ratio of outer edge to core edge, on either side."""

BINS = 60
"""Least width of a core [cycles per record]."""

EDGE = 0.98
"""Largest frequency, relative to half the sampling rate [1]."""


@dataclasses.dataclass(frozen=True, slots=True)
class Passband:
    """Core from `low_hz` to `high_hz`, and the edges between which the band fades [Hz]."""

    low_hz: float
    high_hz: float
    from_hz: float
    to_hz: float

    @property
    def centre_hz(self) -> float:
        """Middle of the band, where the moved series has its zero [Hz]."""
        return 0.5 * (self.from_hz + self.to_hz)

    @property
    def rate_hz(self) -> float:
        """Width of the band, and least rate of the moved series [Hz]."""
        return self.to_hz - self.from_hz

    def gain(self, frequency_hz: Float[np.ndarray, " frequency"]) -> np.ndarray:
        """Gain of the band: 1 in the core, 0 beyond the edges, half a cosine between."""
        rise = (frequency_hz - self.from_hz) / (self.low_hz - self.from_hz)
        fall = (self.to_hz - frequency_hz) / (self.to_hz - self.high_hz)
        inside = np.clip(np.minimum(rise, fall), 0.0, 1.0)
        return np.asarray(0.5 - 0.5 * np.cos(np.pi * inside))


def plan_bands(
    low_hz: float, high_hz: float, rate_hz: float, *, resolution_hz: float
) -> tuple[Passband, ...]:
    """Bands whose cores follow each other from `low_hz` to `high_hz`.

    No band reaches half the rate; `resolution_hz` is one over the duration of the record.

    Examples
    --------
    >>> [round(band.high_hz, 2) for band in plan_bands(1.0, 3.0, 10.0, resolution_hz=0.001)]
    [1.32, 1.73, 2.28, 3.0]
    """
    edges = [low_hz]
    while edges[-1] < high_hz:
        edges.append(max(CORE * edges[-1], edges[-1] + BINS * resolution_hz))
    # Stretched so that the last core ends where it should.
    steps = np.log(np.array(edges) / low_hz)
    edges = (low_hz * np.exp(steps * (np.log(high_hz / low_hz) / steps[-1]))).tolist()
    highest = EDGE * rate_hz / 2
    bands = []
    for low, high in itertools.pairwise(edges):
        skirt = max((MARGIN - 1) * low, 0.5 * (high - low))
        start = max(low - skirt, 0.25 * low)
        stop = min(high + skirt, highest)
        bands.append(Passband(low, min(high, stop - 0.25 * skirt), start, stop))
    return tuple(bands)


def demodulate(
    spectrum: Complex[np.ndarray, "frequency channel"],
    count: int,
    rate_hz: float,
    band: Passband,
) -> tuple[Complex[np.ndarray, "time channel"], float, float]:
    """Series of one band, from the real transform of the whole record.

    The spectrum is ``scipy.fft.rfft(samples, axis=0)``. Gives the series whose real part,
    turned back, is the band; its rate; and what was moved to zero [Hz].
    """
    spacing = rate_hz / count
    first = max(1, int(np.ceil(band.from_hz / spacing)))
    last = min(len(spectrum) - 2, int(np.floor(band.to_hz / spacing)))
    number = fft.next_fast_len(last - first + 1)
    inside = spectrum[first : last + 1]
    inside = inside * band.gain(np.arange(first, last + 1) * spacing)[:, None]
    padded = np.zeros((number, spectrum.shape[1]), dtype=complex)
    padded[: len(inside)] = inside
    middle = len(inside) // 2
    series = fft.ifft(np.roll(padded, -middle, axis=0), axis=0) * (2.0 * number / count)
    return np.asarray(series), number * spacing, (first + middle) * spacing

"""Band-pass filtering and decimation of a series around one mode."""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.signals.decimation import moved_down
from slowtime.signals.finite_filters import Kind, convolved, kaiser_order, windowed_sinc

from .resonance_peaks import PeakCandidate

REACH = 2.5
"""Ratio of the band limits to the candidate's frequency, where no neighbour is nearer."""

MOST_TERMS = 40
"""Largest number of cosines that model the drift; a longer record loses its drift to a
high-pass filter."""

STOP_DB = 70.0
"""Stop-band attenuation of the filters [dB]."""


MOST_SAMPLES = 32_768
"""Length above which a series is reduced to the nearest bins of its candidate [samples]."""

MOST_BINS = 2500
"""Bins on either side that are then kept; a wider decay is over too early to be distinguished
from an impact."""


@dataclasses.dataclass(frozen=True, slots=True)
class IsolatedSeries:
    """What is left of a series around one mode; the first sample was taken at `start_s`."""

    series: Float[np.ndarray, " time"]
    rate_hz: float
    start_s: float
    low_hz: float
    high_hz: float
    drift_hz: float
    shift_hz: float = 0.0
    """What was taken off all frequencies; the band, too, is where the series has it [Hz]."""

    @property
    def band_hz(self) -> tuple[float, float]:
        """Where the mode may be, and where noise is neither drift nor filtered [Hz]."""
        return self.low_hz, self.high_hz


def isolate_mode(
    series: Float[np.ndarray, " time"], rate_hz: float, candidate: PeakCandidate
) -> IsolatedSeries:
    """Filter and decimate a series to the band of a mode; decays stay exact."""
    low = max(candidate.low_hz, candidate.frequency_hz / REACH)
    high = min(candidate.high_hz, candidate.frequency_hz * REACH)
    duration = len(series) / rate_hz
    if 2 * REACH * candidate.frequency_hz * duration > MOST_SAMPLES:
        return _narrowed(series, rate_hz, candidate, low, high)
    # A finite filter whose whole length lies on the record turns a decaying oscillation into
    # itself times a constant: frequency and damping stay, and the edges, where it would not,
    # are given up. What is slower than the band is left to the fit as drift wherever a filter
    # would cost too much of a short record.
    drift, start = low, 0.0
    if 2 * duration * low > MOST_TERMS:
        series, lost = _filtered(series, rate_hz, low / 2, low, "highpass")
        start, drift = start + lost, 0.0
    stop = high + max(high - candidate.frequency_hz, 0.5 * candidate.frequency_hz)
    factor = int(rate_hz // (1.05 * (stop + high)))
    if factor > 1:
        series, lost = _filtered(series, rate_hz, high, stop, "lowpass")
        series, start = series[::factor], start + lost
        rate_hz = rate_hz / factor
    return IsolatedSeries(series, rate_hz, start, low, high, drift)


def _narrowed(
    series: Float[np.ndarray, " time"],
    rate_hz: float,
    candidate: PeakCandidate,
    low: float,
    high: float,
) -> IsolatedSeries:
    """Nearest bins of a candidate of many cycles, moved down to a rate that suits them."""
    reach = MOST_BINS * rate_hz / len(series)
    low = max(low, candidate.frequency_hz - reach)
    high = min(high, candidate.frequency_hz + reach)
    slow = moved_down(series, rate_hz, (low + high) / 2, (high - low) / 2)
    return IsolatedSeries(
        slow.samples[:, 0],
        slow.rate_hz,
        slow.start_s,
        low - slow.shift_hz,
        high - slow.shift_hz,
        0.0,
        slow.shift_hz,
    )


def _filtered(
    series: np.ndarray, rate_hz: float, low: float, high: float, kind: Kind
) -> tuple[np.ndarray, float]:
    """Keep the valid part of a filter with transition `low` to `high`; seconds it loses."""
    length, beta = kaiser_order(STOP_DB, (high - low) / (rate_hz / 2))
    length = min(length | 1, (len(series) // 4) | 1)
    taps = windowed_sinc(length, (low + high) / rate_hz, beta, kind)
    return convolved(series, taps), (length - 1) / 2 / rate_hz

"""Samples in, frequency and width of a spectral peak out: quick, model-free, less precise."""

import numpy as np
from jaxtyping import Float

from slowtime.signals.spectra import detrended, welch

from . import checks
from .bounds import ambient_law
from .combine import modal_series
from .detect import Candidate, strongest
from .identified import Identified, Measured

BINS_PER_HALF_WIDTH = 4.0


def peak(
    samples: Float[np.ndarray, "time channel"] | Float[np.ndarray, " time"],
    rate_hz: float,
    *,
    band_hz: tuple[float, float] | None = None,
) -> Identified:
    """Strongest peak of the Welch spectrum, its place by a parabola, its damping by its width.

    See `fit_peak`. Prefer `identify_ambient` or `identify_free_decay`, which know their errors;
    the peak needs no model and is a check on both.
    """
    columns = detrended(checks.series(samples, rate_hz))
    low, high = checks.band(band_hz, rate_hz, len(columns))
    return fit_peak(columns, rate_hz, strongest(columns, rate_hz, low, high))


def fit_peak(
    columns: Float[np.ndarray, "time channel"], rate_hz: float, candidate: Candidate
) -> Identified:
    r"""Peak near a candidate: a parabola through the inverse spectrum above half power.

    Near a light resonance :math:`1 / S \propto (f - f_n)^2 + \zeta^2 f_n^2`, so a parabola
    through 1/S over the half-power band gives :math:`f_n` and, from its minimum and
    curvature, :math:`\zeta`. Segments are as long as the width of the peak asks for and the
    record allows; where the record is too short for the width, damping is only an upper limit
    and the flag `resolution_limited` says so.
    """
    series = modal_series(columns, rate_hz, candidate)[:, None]
    duration = len(series) / rate_hz
    segment = min(duration, 64.0 / candidate.frequency_hz)
    while True:
        frequency, half_width, top, averages = _parabola(series, rate_hz, segment, candidate)
        longer = min(duration, 2 * segment)
        if half_width * segment > BINS_PER_HALF_WIDTH or longer == segment:
            break
        segment = longer
    damping = min(half_width / frequency, 0.5)
    limited = half_width * segment < 2.0
    law = ambient_law(damping, duration * frequency, reach=1.0)
    resolution = 0.25 / (segment * frequency) / np.sqrt(averages) if limited else 0.0
    return Identified(
        frequency_hz=Measured(frequency, frequency * float(np.hypot(law[0], resolution))),
        damping_ratio=Measured(damping, damping * min(law[1], 1.0)),
        correlation=0.0,
        snr_db=candidate.prominence_db,
        amplitude=float(np.sqrt(top * np.pi / 2 * half_width)),
        method="peak",
        span_s=(0.0, duration),
        flags=("resolution_limited",) if limited else (),
    )


def _parabola(
    series: Float[np.ndarray, "time channel"],
    rate_hz: float,
    segment: float,
    candidate: Candidate,
) -> tuple[float, float, float, float]:
    """Frequency and half width [Hz], top density, and how many segments were averaged."""
    spectrum = welch(series, rate_hz, segment_s=segment)
    density, frequency = spectrum.density[:, 0], spectrum.frequency_hz
    near = np.abs(frequency - candidate.frequency_hz)
    reach = max(2 * spectrum.spacing_hz, 0.1 * candidate.frequency_hz)
    inside = (near <= reach) & (frequency > 0)
    top = int(np.argmax(np.where(inside, density, -1.0)))
    left = right = top
    while left > 1 and density[left - 1] > density[top] / 2:
        left -= 1
    while right < len(density) - 2 and density[right + 1] > density[top] / 2:
        right += 1
    use = slice(
        max(left - 1, 1) if right - left < 2 else left,
        right + 2 if right - left < 2 else right + 1,
    )
    offset = frequency[use] - frequency[top]
    curve, slope, least = np.polyfit(offset, density[top] / density[use], 2)
    averages = max(1.0, 2 * len(series) / (segment * rate_hz) - 1)
    if curve <= 0:
        return float(frequency[top]), spectrum.spacing_hz, float(density[top]), averages
    shift = float(np.clip(-slope / (2 * curve), offset[0], offset[-1]))
    bottom = max(least - slope**2 / (4 * curve), 0.1)
    return (
        float(frequency[top] + shift),
        float(np.sqrt(bottom / curve)),
        float(density[top] / bottom),
        averages,
    )

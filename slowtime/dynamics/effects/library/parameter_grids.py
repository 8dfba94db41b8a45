"""Grids of shape parameters that are plausible for a motion."""

import numpy as np

from slowtime.dynamics.effects.kind import Motion, Series, Shape


def levels(series: Series, *quantiles: float) -> list[float]:
    """Distinct quantiles of the size of the finite samples of a series, without zeros."""
    found = np.quantile(np.abs(series[np.isfinite(series)]), quantiles)
    return [float(level) for level in dict.fromkeys(found) if level > 0]


def within(motion: Motion, count: int) -> list[float]:
    """Campaign times [s] that split the record into equal parts, its ends left out."""
    first, last = float(motion.times[0]), float(motion.times[-1])
    return [float(time) for time in np.linspace(first, last, count + 2)[1:-1]]


def lines_hz(series: Series, times: Series, count: int) -> list[float]:
    """Frequencies at which the spectrum of a series stands out most.

    The strongest come first; there are none for fewer than 16 samples.
    """
    if len(series) < 16:
        return []
    spectrum = np.abs(np.fft.rfft((series - series.mean()) * np.hanning(len(series))))
    inner = np.arange(2, len(spectrum) - 1)
    peaks = inner[
        (spectrum[inner] >= spectrum[inner - 1]) & (spectrum[inner] > spectrum[inner + 1])
    ]
    best = peaks[np.argsort(-spectrum[peaks])[:count]]
    return [float(line / (times[-1] - times[0])) for line in best]


def each(name: str, values: list[float], **fixed: float) -> list[Shape]:
    """Make one shape for each value of one parameter."""
    return [{name: value} | fixed for value in values]

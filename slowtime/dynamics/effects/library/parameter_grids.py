"""Grids of shape parameters that are plausible for a motion."""

import numpy as np

from slowtime.dynamics.effects.kind import Motion, Series, Shape


def levels(series: Series, *quantiles: float) -> list[float]:
    """Quantiles of the size of a series, without zeros.

    Parameters
    ----------
    series
        Series; values that are not finite are left out.
    *quantiles
        Shares of the samples below each quantile [1].

    Returns
    -------
    Distinct quantiles above zero, in the unit of the series.
    """
    found = np.quantile(np.abs(series[np.isfinite(series)]), quantiles)
    return [float(level) for level in dict.fromkeys(found) if level > 0]


def within(motion: Motion, count: int) -> list[float]:
    """Instants that split the record into equal parts, its ends left out.

    Parameters
    ----------
    motion
        Motion, with the times of its samples.
    count
        Number of instants.

    Returns
    -------
    Campaign times [s].
    """
    first, last = float(motion.times[0]), float(motion.times[-1])
    return [float(time) for time in np.linspace(first, last, count + 2)[1:-1]]


def lines_hz(series: Series, times: Series, count: int) -> list[float]:
    """Frequencies at which the spectrum of a series stands out most.

    Parameters
    ----------
    series
        Series of one quantity.
    times
        Campaign times [s], equally spaced.
    count
        Largest number of frequencies.

    Returns
    -------
    Frequencies, the strongest first [Hz]; none for fewer than 16 samples.
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
    """Make one shape for each value of one parameter.

    Parameters
    ----------
    name
        Name of the parameter.
    values
        Its values, in its unit.
    **fixed
        Values of other parameters, the same in all shapes.

    Returns
    -------
    Parameters by name, for each value.
    """
    return [{name: value} | fixed for value in values]

"""Periods of a multisine: found, cut, and transformed."""

import dataclasses

import numpy as np
import scipy.fft
from jaxtyping import Complex, Float

MIN_PERIOD = 16
"""[samples] Below which a multisine has too few lines to tell anything. Source: judgement."""
MIN_REPETITION = 0.95
"""[1] Correlation of an input with itself one period later, from which it counts as periodic.
Source: an input measured with 13 dB of signal over noise, or better."""
SAME_REPETITION = 0.02
"""[1] Correlation by which several periods may repeat better than one: multiples of a period
repeat alike, but for noise. Source: judgement."""

Series = Float[np.ndarray, " time"]
Spectra = Complex[np.ndarray, "period line"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Realisation:
    """Spectra of one multisine and of the response to it, period by period.

    Parameters
    ----------
    input, output
        Fourier coefficients, scaled so that a sine of amplitude A has A / 2 (period, line).
    frequency_hz
        Of the lines.
    level
        Root mean square of the input without its mean.
    """

    input: Spectra
    output: Spectra
    frequency_hz: Float[np.ndarray, " line"]
    level: float

    @property
    def periods(self) -> int:
        """Number of periods."""
        return len(self.input)


def find_period(series: Series) -> int:
    """Length of the period of a signal [samples].

    Parameters
    ----------
    series
        At least two periods of a multisine.

    Returns
    -------
    The least lag at which the signal repeats as well as it does at any.

    Raises
    ------
    ValueError
        Where it does not repeat.

    Examples
    --------
    >>> one = np.random.default_rng(0).standard_normal(50)
    >>> find_period(np.tile(one, 4))
    50
    """
    moved = series - series.mean()
    count = len(moved)
    size = scipy.fft.next_fast_len(2 * count)
    spectrum = np.fft.rfft(moved, size)
    products = np.fft.irfft(np.abs(spectrum) ** 2, size)[: count // 2 + 1]
    squares = np.cumsum(moved**2)
    lags = np.arange(count // 2 + 1)
    early = squares[count - 1 - lags]
    late = squares[-1] - np.concatenate([[0.0], squares])[lags]
    size_of = np.sqrt(np.maximum(early * late, np.finfo(float).tiny))
    alike = products / size_of
    alike[:MIN_PERIOD] = -1.0
    # A smooth signal is like itself shortly after: what counts are maxima.
    peaks = np.flatnonzero((alike[1:-1] >= alike[:-2]) & (alike[1:-1] >= alike[2:])) + 1
    peaks = np.append(peaks, count // 2)[: len(peaks) + 1]
    best = float(alike[peaks].max(initial=-1.0))
    if best < MIN_REPETITION:
        raise ValueError(
            f"The input repeats with a correlation of {best:.2f} at best: there are no two "
            f"periods of one multisine in {count} samples. Give the length of one with "
            "`period`, or cut the record with FILE@FROM:TO."
        )
    return int(peaks[np.flatnonzero(alike[peaks] >= best - SAME_REPETITION)[0]])


def realisation_of(
    given: Series, told: Series, rate_hz: float, period: int, transient: int = 0
) -> Realisation:
    """Cut whole periods from the end of a record, and transform them.

    Parameters
    ----------
    given, told
        Input and output.
    rate_hz
        Sampling rate [Hz].
    period
        Length of a period [samples].
    transient
        Samples at the beginning to leave out at least.

    Raises
    ------
    ValueError
        Where no whole period is left.
    """
    if period < MIN_PERIOD:
        raise ValueError(
            f"A period of {period} samples has too few lines. Give {MIN_PERIOD} or more."
        )
    count = (len(given) - transient) // period
    if count < 1:
        raise ValueError(
            f"The record has {len(given)} samples, {transient} of them transient: not one "
            f"period of {period}. Give a longer record, or fewer samples of --setting "
            "transient."
        )
    first = len(given) - count * period
    spectra = [
        np.fft.rfft(series[first:].reshape(count, period), axis=1) / period
        for series in (given, told)
    ]
    return Realisation(
        input=spectra[0],
        output=spectra[1],
        frequency_hz=np.fft.rfftfreq(period, 1 / rate_hz),
        level=float(given[first:].std()),
    )

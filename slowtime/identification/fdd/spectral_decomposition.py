r"""Singular value decomposition of the spectral matrix, and its peaks.

.. math:: \hat S(f) = \frac{\sum_k w_k F_k F_k^H}{\sum_k w_k} = \sum_i s_i u_i u_i^H, \qquad
          w_k = \Bigl(1 - \Bigl(\frac{f_k - f}{h(f)}\Bigr)^2\Bigr)^3

Near a mode the first singular value is its spectrum and the first vector its shape. In place of
segments, whose length would have to suit all modes, neighbouring ordinates of the whole record
are averaged over a share h of the frequency, as a resonance is wide in proportion to it.
"""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification import checks
from slowtime.identification.estimates import Measured
from slowtime.identification.harmonics.tones import remove_lines
from slowtime.identification.subspace.bands import EDGE
from slowtime.signals.peaks import local_maxima, prominences
from slowtime.signals.spectra import detrended, transform

RESOLUTION = 0.01
"""Half-width of the average, relative to frequency [1]."""

FEWEST_BINS = 6
"""Half-width of the average, at least [ordinates]; also at least the number of channels."""

PLACES = 4
"""Frequencies evaluated per half-width."""

FEWEST_CYCLES = 20
"""Lowest frequency of the search [cycles per record]."""

STANDS_OUT = 7.0
r"""Least prominence of a peak of the log singular value, times :math:`\sqrt{n}` of the n
ordinates averaged."""

LINE_BINS = 2
"""Bins removed on either side of a machine line."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ScaledCoefficients:
    """Fourier coefficients of the channels that move, each channel scaled to the same level."""

    frequency_hz: Float[np.ndarray, " bin"]
    coefficients: Complex[np.ndarray, "bin channel"]
    scale: Float[np.ndarray, " channel"]
    moving: np.ndarray
    rate_hz: float
    count: int

    @property
    def duration_s(self) -> float:
        """Of the record [s]."""
        return self.count / self.rate_hz

    def half_width_hz(self, frequency_hz: float, resolution: float) -> float:
        """Half-width of the average about a frequency [Hz]."""
        fewest = max(FEWEST_BINS, self.coefficients.shape[1]) / self.duration_s
        return float(max(resolution * frequency_hz, fewest))


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SpectralDecomposition:
    """Singular values, descending, and first vectors; `number` is of ordinates averaged."""

    frequency_hz: Float[np.ndarray, " place"]
    values: Float[np.ndarray, "place value"]
    vectors: Complex[np.ndarray, "place channel"]
    number: Float[np.ndarray, " place"]
    peaks: tuple[int, ...]

    def valley(self, one: int, other: int) -> int:
        """Index of the least first singular value between two places."""
        low, high = sorted((one, other))
        return low + int(np.argmin(self.values[low : high + 1, 0]))


def scaled_coefficients(
    samples: Float[np.ndarray, "time channel"] | Float[np.ndarray, " time"],
    rate_hz: float,
    lines: tuple[Measured, ...] = (),
) -> ScaledCoefficients:
    """Fourier coefficients of a record, without the bins of machine lines.

    Channels that move are scaled to equal level.
    """
    columns = detrended(checks.series(samples, rate_hz))
    moving = checks.moving(samples[:, None] if samples.ndim == 1 else samples)
    if lines:
        columns = remove_lines(columns, rate_hz, lines)
    frequency, coefficients = transform(columns, rate_hz)
    size = np.abs(coefficients)
    scale = np.median(size, axis=0) + 1e-9 * size.max(axis=0)
    use = frequency > 0
    for line in lines:
        reach = LINE_BINS * rate_hz / len(columns) + 2.0 * line.sd
        use &= np.abs(frequency - line.value) > reach
    return ScaledCoefficients(
        frequency[use], coefficients[use] / scale, scale, moving, rate_hz, len(columns)
    )


def kernel_weights(away: Float[np.ndarray, " bin"]) -> Float[np.ndarray, " bin"]:
    """Weights of ordinates in the spectral average [1]."""
    return np.asarray(np.maximum(1 - away**2, 0.0) ** 3)


def decompose_spectrum(
    data: ScaledCoefficients,
    *,
    band_hz: tuple[float, float] | None = None,
    resolution: float = RESOLUTION,
) -> SpectralDecomposition:
    """Singular value decomposition of the whole spectrum, with its significant peaks.

    Two modes nearer to each other than `resolution`, relative to the frequency, are seen as
    one.
    """
    low, high = _modelled_band(band_hz, data)
    # All from 20 cycles in the record to nearly half the rate is covered, so that peaks and
    # valleys do not depend on the band that is reported.
    places = [low]
    while places[-1] < high:
        places.append(places[-1] + data.half_width_hz(places[-1], resolution) / PLACES)
    kept, values, vectors, number = [], [], [], []
    for place in places:
        near, w = ordinates_about(data, place, data.half_width_hz(place, resolution))
        if len(w) < data.coefficients.shape[1]:
            continue
        part = data.coefficients[near]
        found, directions = np.linalg.eigh((part.T * w) @ part.conj() / w.sum())
        kept.append(place)
        values.append(np.maximum(found[::-1], 0.0))
        vectors.append(directions[:, -1])
        number.append(w.sum() ** 2 / (w @ w))
    singular, count = np.array(values), np.array(number)
    return SpectralDecomposition(
        frequency_hz=np.array(kept),
        values=singular,
        vectors=np.array(vectors),
        number=count,
        peaks=_peaks(singular[:, 0], count),
    )


def ordinates_about(
    data: ScaledCoefficients, place_hz: float, half_width_hz: float
) -> tuple[slice, Float[np.ndarray, " bin"]]:
    """Ordinates about a frequency, and their weights."""
    edges = place_hz - half_width_hz, place_hz + half_width_hz
    first, last = np.searchsorted(data.frequency_hz, edges)
    away = (data.frequency_hz[first:last] - place_hz) / half_width_hz
    return slice(int(first), int(last)), kernel_weights(away)


def _modelled_band(
    band_hz: tuple[float, float] | None, data: ScaledCoefficients
) -> tuple[float, float]:
    low, high = FEWEST_CYCLES / data.duration_s, 0.95 * EDGE * data.rate_hz / 2
    if band_hz is not None:
        given = checks.band(band_hz, data.rate_hz, data.count)
        return checks.modelled_band(given, (low, high))
    if low >= high:
        raise ValueError(
            f"{data.count} samples at {data.rate_hz:g} Hz hold {FEWEST_CYCLES} cycles of "
            "nothing below half the rate. Give a longer record."
        )
    return low, high


def _peaks(
    first: Float[np.ndarray, " place"], number: Float[np.ndarray, " place"]
) -> tuple[int, ...]:
    """Local maxima that stand out on both sides by more than chance would have it."""
    logarithm = np.log(np.maximum(first, np.finfo(float).tiny))
    tops = local_maxima(logarithm)
    prominence = prominences(logarithm, tops)
    return tuple(int(top) for top in tops[prominence * np.sqrt(number[tops]) > STANDS_OUT])

"""Decimation of samples without aliasing into the band that is kept.

Both filters are finite and give only what they see whole: a decaying oscillation within the
band comes out as itself times a constant, so that its frequency and its decay are those of the
samples.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from .finite_filters import kaiser_order, windowed_sinc

STOP_DB = 80.0
"""What is folded into the band that is kept is so much weaker than it was [dB]."""

PASS = 0.8
"""Share of half the lower rate up to which nothing is changed."""

PIECE = 4096
"""Values that are filtered at once: it bounds memory."""

BAND_SHARE = 6.0
"""Rate of a band that was moved down, in units of its half-width: a band that fades over half
its half-width, and as much room to either side."""


@dataclasses.dataclass(frozen=True, slots=True)
class Decimated:
    """Samples at a lower rate; the first was taken at `start_s`.

    What was at f is at f - `shift_hz` now.
    """

    samples: Float[np.ndarray, "time channel"]
    rate_hz: float
    start_s: float
    shift_hz: float = 0.0


def decimated(
    samples: Float[np.ndarray, "time channel"], rate_hz: float, factor: int
) -> Decimated:
    """Lower the rate of samples, unchanged up to 0.8 of half the lower rate.

    Parameters
    ----------
    samples
        Equally spaced, one column per channel, any unit.
    rate_hz
        Samples per second [Hz].
    factor
        Whole number from 1 up.

    Returns
    -------
    Samples at the lower rate, with the first instant [s].

    Examples
    --------
    >>> sine = np.sin(2 * np.pi * 3.0 * np.arange(10_000) / 1000.0)[:, None]
    >>> slow = decimated(sine, 1000.0, 25)
    >>> instants = slow.start_s + np.arange(len(slow.samples)) / slow.rate_hz
    >>> bool(np.abs(slow.samples[:, 0] - np.sin(2 * np.pi * 3.0 * instants)).max() < 1e-3)
    True
    """
    if factor == 1:
        return Decimated(samples, rate_hz, 0.0)
    half = rate_hz / factor / 2
    taps = _lowpass(rate_hz, PASS * half, half, factor)
    columns = [_decimated(column, taps, factor) for column in samples.T]
    return Decimated(np.stack(columns, axis=1), rate_hz / factor, (len(taps) - 1) / 2 / rate_hz)


def moved_down(
    series: Float[np.ndarray, " time"], rate_hz: float, centre_hz: float, half_width_hz: float
) -> Decimated:
    r"""Shift a band of a series down, to a rate of about six times half its width.

    The band :math:`f_c \pm w` comes to lie about a quarter of the lower rate: with the complex
    filter h of that band,

    .. math:: y_m = 2\,\mathrm{Re} \Bigl( e^{-2 \pi i \, \Delta f \, t_m}
              \sum_n h_n \, x(t_m - n \Delta t) \Bigr)

    so that a pole s of the series is at :math:`s - 2 \pi i\, \Delta f` in y, `shift_hz` being
    :math:`\Delta f`.

    Parameters
    ----------
    series
        Equally spaced, any unit.
    centre_hz, half_width_hz
        :math:`f_c` and w [Hz]; what is beyond 1.5 w is gone.

    Returns
    -------
    Real samples at the lower rate, with the first instant [s] and the frequency shift [Hz].

    Examples
    --------
    >>> instants = np.arange(50_000) / 1000.0
    >>> decay = np.exp(-0.2 * instants) * np.cos(2 * np.pi * 123.0 * instants)
    >>> slow = moved_down(decay, 1000.0, 122.0, 5.0)
    >>> spectrum = np.abs(np.fft.rfft(slow.samples[:, 0]))
    >>> top = np.argmax(spectrum) / len(slow.samples) * slow.rate_hz
    >>> round(float(top + slow.shift_hz), 1), len(slow.samples) < 2000
    (123.0, True)
    """
    factor = max(1, int(rate_hz / (BAND_SHARE * half_width_hz)))
    lower = rate_hz / factor
    taps = _lowpass(rate_hz, half_width_hz, 1.5 * half_width_hz, factor)
    shift = centre_hz - lower / 4
    turn = np.exp(2j * np.pi * centre_hz / rate_hz * (np.arange(len(taps)) - len(taps) // 2))
    taps = taps * turn
    kept = _decimated(series, taps.real.copy(), factor) + 1j * _decimated(
        series, taps.imag.copy(), factor
    )
    start = (len(taps) - 1) / 2 / rate_hz
    instants = start + np.arange(len(kept)) / lower
    moved = 2 * (kept * np.exp(-2j * np.pi * shift * instants)).real
    return Decimated(np.asarray(moved)[:, None], lower, start, shift)


def _lowpass(
    rate_hz: float, pass_hz: float, stop_hz: float, factor: int
) -> Float[np.ndarray, " tap"]:
    """Taps of linear phase, an even multiple of `factor` and one more."""
    length, beta = kaiser_order(STOP_DB, (stop_hz - pass_hz) / (rate_hz / 2))
    length = 2 * factor * -(-(length - 1) // (2 * factor)) + 1
    return windowed_sinc(length, (pass_hz + stop_hz) / rate_hz, beta, "lowpass")


def _decimated(
    series: Float[np.ndarray, " time"], taps: Float[np.ndarray, " tap"], factor: int
) -> Float[np.ndarray, " kept"]:
    """Every `factor`-th of the values that the filter sees whole, from the first on."""
    if len(series) < len(taps):
        raise ValueError(
            f"A series of {len(series)} samples is shorter than the filter of {len(taps)} that "
            f"lowers its rate {factor} times. Give a longer record, or lower the rate less."
        )
    count = (len(series) - len(taps)) // factor + 1
    rows = -(-len(taps) // factor)
    phases = np.zeros((rows, factor))
    phases.flat[: len(taps)] = taps[::-1]
    kept = np.empty(count)
    for first in range(0, count, PIECE):
        last = min(first + PIECE, count)
        part = np.zeros((last - first + rows - 1, factor))
        own = series[first * factor : first * factor + part.size]
        part.flat[: len(own)] = own
        products = part @ phases.T
        kept[first:last] = sum(products[row : row + last - first, row] for row in range(rows))
    return kept

r"""Band-limited interpolation at arbitrary times.

.. math:: u(t) = \sum_k u_k \, h(t f_s - k), \qquad h(x) = \frac{\sin \pi x}{\pi x} \, w(x)

with a Blackman–Harris window :math:`w` over `REACH` samples on either side: a part in 10^4 up
to 0.43 of the sampling rate. Beyond its ends a record goes on turned about its last point.
"""

import functools

import numpy as np
from jaxtyping import Float, Int

Series = Float[np.ndarray, " time"]
Instants = Float[np.ndarray, " instant"]

REACH = 32
"""Samples on either side that a value between samples is made of."""

TERMS = 10
"""Of the polynomials that its parts are in the fraction of a sample: right to 1e-6 half way."""
SAME = 1e-9
"""Of a sample: fractions that differ by less are one."""

DEGREE = 5
"""Of the polynomials that stand for a signal between two samples."""

HOLDS = ("band_limited", "first", "zero")
"""What a signal may do between its samples."""

_WINDOW = (0.35875, 0.48829, 0.14128, 0.01168)
_BLEND = np.array(
    [  # quintic Hermite: rows powers 0..5 of s, columns u0, u0', u0'', u1, u1', u1''
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.5, 0.0, 0.0, 0.0],
        [-10.0, -6.0, -1.5, 10.0, -4.0, 0.5],
        [15.0, 8.0, 1.5, -15.0, 7.0, -1.0],
        [-6.0, -3.0, -0.5, 6.0, -3.0, 0.5],
    ]
)


def at_instants(
    series: Float[np.ndarray, "*any time"], positions: Instants
) -> Float[np.ndarray, "*any instant"]:
    """Values of band-limited signals between their samples.

    Parameters
    ----------
    series
        One signal, or several; the last axis is time.
    positions
        In samples, counted from the first; held to `REACH` beyond the ends.

    Returns
    -------
    Values, in the unit of the series.

    Examples
    --------
    >>> wave = np.sin(0.9 * np.arange(200))
    >>> bool(abs(at_instants(wave, np.array([100.3]))[0] - np.sin(0.9 * 100.3)) < 1e-4)
    True
    """
    length = series.shape[-1]
    place = np.clip(positions, -REACH, length - 1 + REACH) + 2 * REACH
    # Counted from the nearest sample, a fraction has all its digits, and so has its sine.
    nearest = np.rint(place)
    fraction, at = place - nearest, nearest.astype(int)
    rows = [_extended(row, 3 * REACH) for row in series.reshape(-1, length)]
    if np.ptp(fraction) < SAME:
        taps = _taps(np.array([fraction.mean()]))[0]
        found = [np.convolve(row, taps, "valid")[at] for row in rows]
    else:
        found = [_between(row, at, fraction) for row in rows]
    return np.array(found).reshape(*series.shape[:-1], len(place))


def _between(
    longer: Float[np.ndarray, " longer"], at: Int[np.ndarray, " instant"], fraction: Instants
) -> Instants:
    """Values beside samples, by what the taps are as polynomials in the fraction."""
    around = np.zeros(len(at))
    for taps in _polynomial_taps()[::-1]:
        around = around * fraction + np.convolve(longer, taps, "valid")[at]
    middle = np.sinc(fraction) * _window(fraction) * longer[at + REACH]
    return np.asarray(middle + fraction * around)


def _taps(fraction: Instants) -> Float[np.ndarray, "instant tap"]:
    """Tell what the samples around an instant count, the last first."""
    x = fraction[:, None] - np.arange(REACH, -REACH - 1, -1)
    return np.asarray(np.sinc(x) * _window(x))


@functools.cache
def _polynomial_taps() -> Float[np.ndarray, "power tap"]:
    """Coefficients, by power of the fraction, of all taps but the middle one, over it."""
    fraction = np.cos(np.pi * (np.arange(TERMS) + 0.5) / TERMS) / 2
    taps = _taps(fraction) / fraction[:, None]
    taps[:, REACH] = 0.0
    return np.asarray(np.linalg.solve(fraction[:, None] ** np.arange(TERMS), taps))


def polynomials(series: Series, hold: str) -> Float[np.ndarray, "time power"]:
    r"""Coefficients of :math:`u(s) = \sum_j c_j s^j` from each sample to the next, s in 0..1.

    Parameters
    ----------
    series
        Samples of the signal.
    hold
        ``"band_limited"``: the band-limited signal through the samples, by quintic Hermite
        polynomials with its own derivatives (a part in 3000 at a quarter of the sampling rate,
        in 10^6 at a tenth); ``"first"``: straight lines; ``"zero"``: steps. The last row
        stays at the last value.

    Returns
    -------
    Coefficients, in the unit of the series.
    """
    if hold not in HOLDS:
        raise ValueError(
            f"{hold=} is not a valid way to hold a signal. Allowed: {', '.join(HOLDS)}."
        )
    found = np.zeros((len(series), DEGREE + 1))
    found[:, 0] = series
    if hold == "first":
        found[:-1, 1] = np.diff(series)
    elif hold == "band_limited" and len(series) > 1:
        slope, bend = _derivatives(series)
        ends = np.stack(
            [series[:-1], slope[:-1], bend[:-1], series[1:], slope[1:], bend[1:]], axis=1
        )
        found[:-1] = ends @ _BLEND.T
    return found


def _derivatives(series: Series) -> tuple[Series, Series]:
    """First and second derivative at the samples, time in samples."""
    k = np.arange(-REACH, REACH + 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.where(k == 0, 0.0, np.cos(np.pi * k) / k)
        bend = np.where(k == 0, -(np.pi**2) / 3, -2 * np.cos(np.pi * k) / k**2)
    window, tilt, curve = _window(k.astype(float)), np.zeros(len(k)), 0.0
    for i, share in enumerate(_WINDOW):
        turn = np.pi * i / REACH
        tilt -= share * turn * np.sin(turn * k)
        curve -= share * turn**2
    second = bend * window + 2 * slope * tilt
    second[REACH] += curve
    longer = _extended(series, REACH)
    first = slope * window
    return np.convolve(longer, first, "valid"), np.convolve(longer, second, "valid")


def _window(x: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
    turn = np.cos(np.pi / REACH * np.clip(x, -REACH, REACH))
    a, b, c, d = _WINDOW
    # Cosines of twice and thrice the angle, from that of the angle.
    return np.asarray(a - c + turn * (b - 3 * d + turn * (2 * c + 4 * d * turn)))


def _extended(series: Series, reach: int) -> Float[np.ndarray, " longer"]:
    """Go on beyond both ends, turned about the end points."""
    before = 2 * series[0] - series[1 : reach + 1][::-1]
    after = 2 * series[-1] - series[-reach - 1 : -1][::-1]
    before = np.concatenate(
        [np.full(reach - len(before), before[0] if len(before) else series[0]), before]
    )
    after = np.concatenate(
        [after, np.full(reach - len(after), after[-1] if len(after) else series[-1])]
    )
    return np.concatenate([before, series, after])

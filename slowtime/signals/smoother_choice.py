r"""A drop to be noticed in time, and how often to err → window, median and EWMA.

Readings of a frequency are made of windows of w seconds and smoothed by `MedianEwma`. An alarm
is a smoothed value below :math:`f - L \sigma_z`. For white errors of the readings, sd
:math:`\sigma`, the smoothed value has :math:`\sigma_z = \sigma \sqrt{c_n a / (2 - a)}` with the
penalty :math:`c_n \le 1` of the median stage, and its course is that of the process
:math:`z \leftarrow (1 - a) z + a m`. The number of readings until that process first alarms
solves an integral equation [1]_; the median stage makes neighbours more alike at the same
:math:`\sigma_z`, so that the true number is larger (Slepian's inequality [2]_).

References
----------
.. [1] S. V. Crowder, "A simple method for studying run-length distributions of exponentially
   weighted moving average charts", Technometrics 29 (1987), 401-407.
.. [2] D. Slepian, "The one-sided barrier problem for Gaussian noise", Bell System Technical
   Journal 41 (1962), 463-501.
"""

import dataclasses
import functools
import math

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq
from scipy.special import ndtr, ndtri

from .smoothing import MedianEwma, median_penalty

YEAR_S = 365.25 * 86_400.0
NODES = 200
LOWEST = -7.0
"""[sd of the smoothed value] Where the course of the smoothed value is cut off: lower values
come once in a million million readings."""
HIGHEST = 6.0
"""[sd of the smoothed value] Largest limit: it is passed once in 1e9 readings or more."""
DEGREE = 12
"""Of the polynomial in the limit that the logarithm of a run length is, within 1e-4."""
WEIGHTS = np.geomspace(0.02, 1.0, 20)
"""EWMA weights that are compared, in steps of a quarter."""
MOST_OUTLIERS = 49
"""In a row, of the longest median that an edge agent takes."""


@dataclasses.dataclass(frozen=True, slots=True)
class SmootherChoice:
    """Window, median and EWMA, and what they promise.

    Parameters
    ----------
    window_s
        Window of one reading [s].
    median_window
        Readings of the median, odd.
    ewma_a
        Weight of the newest median [1].
    limit
        Fall of the smoothed value at which to alarm, relative to the frequency [1].
    sd
        Standard deviation of the smoothed value, relative to the frequency [1].
    smallest_drop
        Sudden relative fall that is noticed within the stated time with the stated
        probability [1].
    lag_s
        Mean age of what a smoothed value rests on [s].
    false_alarms_per_year
        Expected number, at most [1/year].
    """

    window_s: float
    median_window: int
    ewma_a: float
    limit: float
    sd: float
    smallest_drop: float
    lag_s: float
    false_alarms_per_year: float


def choose_smoother(
    *,
    drop: float,
    within_s: float,
    false_alarms_per_year: float,
    sd: float,
    sd_window_s: float,
    shortest_window_s: float,
    outliers_in_a_row: int = 2,
    probability: float = 0.9,
) -> SmootherChoice:
    """Choose how to smooth a frequency so that a sudden drop is noticed in time.

    Of all windows, and weights of the EWMA, those by which the smallest drop is noticed within
    the time; errors of readings are taken for independent, with a variance in inverse
    proportion to the window.

    Parameters
    ----------
    drop
        Sudden relative fall of the frequency to be noticed [1]; half as large as the relative
        loss of stiffness behind it.
    within_s
        Time from the fall to the alarm [s].
    false_alarms_per_year
        Expected number while nothing changes [1/year].
    sd, sd_window_s
        Standard deviation of one reading, relative to the frequency [1], and its window [s].
    shortest_window_s
        Below which a reading no longer follows that law [s].
    outliers_in_a_row
        Wrong readings, one after the other, that must not move the smoothed value: the median
        takes twice as many and one.
    probability
        With which the fall is noticed within the time [1].

    Returns
    -------
    The choice; `smallest_drop` is at most `drop`.

    Raises
    ------
    ValueError
        For numbers that are impossible, and where no choice notices such a drop in time: it
        says which drop can be noticed.

    Examples
    --------
    >>> found = choose_smoother(drop=0.01, within_s=86_400.0, false_alarms_per_year=1.0,
    ...     sd=0.003, sd_window_s=600.0, shortest_window_s=60.0)
    >>> found.median_window, found.smallest_drop < 0.01
    (5, True)
    """
    _refuse(locals())
    windows = _windows(shortest_window_s, within_s / (outliers_in_a_row + 2))
    smoothers = [MedianEwma(window=2 * outliers_in_a_row + 1, a=a) for a in WEIGHTS.tolist()]
    choices = [
        _promised(w, one, sd * math.sqrt(sd_window_s / w), within_s, false_alarms_per_year,
                  probability)
        for w in windows.tolist()
        for one in smoothers
    ]  # fmt: skip
    best = min(choices, key=lambda one: one.smallest_drop, default=None)
    if best is None or best.smallest_drop > drop:
        able = (
            f"A drop of {best.smallest_drop:.2g} can be"
            if best is not None
            else f"Windows of {shortest_window_s:g} s are too long for any to be"
        )
        raise ValueError(
            f"No smoothing notices a sudden drop of {drop:g} within {within_s:g} s with "
            f"{false_alarms_per_year:g} false alarms a year. {able}. Allow more time or more "
            "false alarms, or measure with more channels or less noise."
        )
    return best


def _refuse(given: dict[str, float]) -> None:
    for name, value in given.items():
        if not math.isfinite(value) or (value <= 0 and name != "outliers_in_a_row"):
            raise ValueError(f"{name}={value} was given. Allowed: finite and above 0.")
    if not 0.0 < given["drop"] < 1.0:
        raise ValueError(f"drop={given['drop']} was given. Allowed: between 0 and 1.")
    if not 0.5 <= given["probability"] < 1.0:
        raise ValueError(
            f"probability={given['probability']} was given. Allowed: from 0.5 to below 1."
        )
    if not 0 <= given["outliers_in_a_row"] <= MOST_OUTLIERS:
        raise ValueError(
            f"outliers_in_a_row={given['outliers_in_a_row']} was given. Allowed: 0 to "
            f"{MOST_OUTLIERS}."
        )


def _windows(shortest_s: float, longest_s: float) -> Float[np.ndarray, " window"]:
    """Windows to be compared [s], each twice as long as the last."""
    if longest_s < shortest_s:
        return np.zeros(0)
    return shortest_s * 2.0 ** np.arange(int(math.log2(longest_s / shortest_s)) + 1)


def _promised(
    window_s: float,
    smoother: MedianEwma,
    sd: float,
    within_s: float,
    per_year: float,
    probability: float,
) -> SmootherChoice:
    settled = settled_sd(smoother) * sd
    factor = limit_factor(smoother.a, YEAR_S / (window_s * per_year))
    # The window in which the drop falls shows but a part of it.
    reached, short = _answer(smoother, math.floor(within_s / window_s) - 1)
    needed = (factor + float(ndtri(probability))) * settled + short * sd
    return SmootherChoice(
        window_s=window_s,
        median_window=smoother.window,
        ewma_a=smoother.a,
        limit=factor * settled,
        sd=settled,
        smallest_drop=needed / reached if reached > 0.0 else math.inf,
        lag_s=(smoother.lag + 0.5) * window_s,
        false_alarms_per_year=per_year,
    )


def _answer(smoother: MedianEwma, readings: int) -> tuple[float, float]:
    """Share of a sudden drop that is shown after so many readings, and what errors take of it.

    As soon as most readings of the median have dropped, it is the r-th smallest of those that
    have, and no longer the middle one: too small a drop by an expected order statistic (Blom
    1958) of their errors, which is the second number [sd of a reading].
    """
    middle = smoother.window // 2 + 1
    dropped = np.arange(middle, readings + 1)
    weights = smoother.a * (1.0 - smoother.a) ** np.arange(len(dropped))[::-1]
    among = np.minimum(dropped, smoother.window)
    late = ndtri((middle - 0.375) / (among + 0.25))
    return float(weights.sum()), float(weights @ late)


def settled_sd(smoother: MedianEwma) -> float:
    """Divide the settled standard deviation of a smoothed value by that of a reading.

    Parameters
    ----------
    smoother
        Median and EWMA.

    Returns
    -------
    Ratio [1], on the safe side by up to 6 % (`median_penalty`).

    Examples
    --------
    >>> settled_sd(MedianEwma(window=1, a=1.0))
    1.0
    """
    count = 1 if smoother.a == 1.0 else math.ceil(math.log(1e-9) / math.log(1.0 - smoother.a))
    ewma = smoother.a * (1.0 - smoother.a) ** np.arange(count)
    weights = np.convolve(ewma, np.full(smoother.window, 1.0 / smoother.window))
    return math.sqrt(median_penalty(smoother.window) * float(weights @ weights))


def limit_factor(a: float, readings: float) -> float:
    """Limit of an EWMA that is passed once in so many readings while nothing changes.

    Parameters
    ----------
    a
        Weight of the newest reading [1].
    readings
        Mean number until the first alarm [1].

    Returns
    -------
    Limit [settled standard deviations of the EWMA], on one side.

    Examples
    --------
    >>> round(limit_factor(1.0, 740.8), 2)
    3.0
    """
    logarithm = _log_run_length(a)
    if not logarithm(0.0) < math.log(readings) < logarithm(HIGHEST):
        raise ValueError(
            f"A false alarm in {readings:.3g} readings was asked for. Allowed: in "
            f"{math.exp(logarithm(0.0)):.1f} to {math.exp(logarithm(HIGHEST)):.3g}."
        )
    return float(brentq(lambda h: logarithm(h) - math.log(readings), 0.0, HIGHEST))


@functools.cache
def _log_run_length(a: float) -> np.polynomial.Chebyshev:
    def each(limits: Float[np.ndarray, " limit"]) -> Float[np.ndarray, " limit"]:
        return np.log([run_length(a, float(limit)) for limit in limits])

    return np.polynomial.Chebyshev.interpolate(each, DEGREE, [0.0, HIGHEST])


def run_length(a: float, limit: float) -> float:
    """Mean number of readings until an EWMA first passes a limit on one side.

    Parameters
    ----------
    a
        Weight of the newest reading [1].
    limit
        Limit [settled standard deviations of the EWMA].

    Returns
    -------
    Readings [1], beginning with a smoothed value without error.

    Examples
    --------
    >>> round(run_length(1.0, 3.0), 1)
    740.8
    """
    if a == 1.0:
        return float(1.0 / ndtr(-limit))
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    x = 0.5 * (limit - LOWEST) * (nodes + 1.0) + LOWEST
    spread = math.sqrt(a * (2.0 - a))  # of one step, in settled standard deviations
    steps = (x[None, :] - (1.0 - a) * x[:, None]) / spread
    kernel = np.exp(-0.5 * steps**2) / (spread * math.sqrt(2.0 * math.pi))
    kernel = kernel * (0.5 * (limit - LOWEST) * weights)[None, :]
    lengths = np.linalg.solve(np.eye(NODES) - kernel, np.ones(NODES))
    first = np.exp(-0.5 * (x / spread) ** 2) / (spread * math.sqrt(2.0 * math.pi))
    return float(1.0 + first * (0.5 * (limit - LOWEST) * weights) @ lengths)

r"""Filters of series in slow time, with one value per epoch.

They are for the series of identified frequencies, never for the vibration itself. Before a
modal identification a moving average or an EWMA changes gain and phase inside the band of
interest, and so the frequency and the damping read from it; a median is nonlinear and makes
harmonics that look like modes. On a series of frequencies, slow beside its sampling, they do
what they are meant to do, at the price of a delay, which is stated with each.

All are causal. A reading that is NaN is missing: a filter passes over it, and
gives NaN there.
"""

import math

import numpy as np
from jaxtyping import Bool, Float

from .recursive_filters import first_order

Series = Float[np.ndarray, " time"]


def fir(x: Series, weights: Float[np.ndarray, " tap"]) -> Series:
    r"""Weighted sum of the latest readings (eq. 1.9).

    .. math:: y_k = \sum_{i=1}^N b_i x_{k-i+1}

    Parameters
    ----------
    x
        Readings.
    weights
        :math:`b_i`, the newest reading's first. They sum to 1 in a smoother, whose white-noise
        variance gain is :math:`\sum b_i^2`; the book asks it of all filters, needlessly.

    Returns
    -------
    NaN until as many readings have come as there are weights.
    """
    if len(weights) == 0:
        raise ValueError("fir() was given no weights. Give at least one.")
    present = np.isfinite(x)
    readings = np.append(np.zeros(len(weights) - 1), x[present])
    filtered = np.convolve(readings, weights, "valid") if present.any() else x[present]
    filtered[: len(weights) - 1] = np.nan
    return _with_missing(filtered, present)


def moving_average(x: Series, window: int) -> Series:
    """Mean of the latest `window` readings (eq. 1.10).

    White-noise variance gain ``1 / window``, delay ``(window - 1) / 2`` readings.

    Parameters
    ----------
    x
        Readings in order of time.
    window
        Number of readings.

    Returns
    -------
    Filtered readings.

    Examples
    --------
    >>> moving_average(np.array([1.0, 3.0, 5.0]), 2)
    array([nan,  2.,  4.])
    """
    _check_window(window)
    return fir(x, np.full(window, 1.0 / window))


def ewma(x: Series, a: float) -> Series:
    r"""Exponentially weighted moving average (eq. 1.11).

    .. math:: y_k = a x_k + (1 - a) y_{k-1}, \qquad y_1 = x_1

    White-noise variance gain :math:`a / (2 - a)`, delay :math:`(1 - a) / a` readings.

    Parameters
    ----------
    x
        Readings.
    a
        Weight of the newest, in (0, 1].

    Returns
    -------
    Filtered series, in the unit of `x`.
    """
    check_weight(a)
    present = np.isfinite(x)
    readings = x[present]
    if len(readings) == 0:
        return _with_missing(readings, present)
    driven = np.append(readings[0], a * readings[1:])
    return _with_missing(first_order(driven, 1.0 - a), present)


def median(x: Series, window: int) -> Series:
    r"""Median of the latest `window` readings, an odd number (eq. 1.12, 1.13).

    Kills up to ``(window - 1) / 2`` outliers in a window. Delay ``(window - 1) / 2`` readings;
    white-noise variance gain :math:`\pi / (2 N)` for many readings :math:`N`, 57 % above the
    mean's. Until the window is full, the median of what has come.

    Parameters
    ----------
    x
        Readings in order of time.
    window
        Odd number of readings.

    Returns
    -------
    Filtered readings.

    Examples
    --------
    >>> median(np.array([5.0, 5.1, 50.0, 5.2, 5.1]), 3)
    array([5.  , 5.05, 5.1 , 5.2 , 5.2 ])
    """
    check_odd_window(window)
    present = np.isfinite(x)
    readings = x[present]
    padded = np.concatenate((np.full(window - 1, np.nan), readings))
    if len(readings) == 0:
        return _with_missing(readings, present)
    windows = np.lib.stride_tricks.sliding_window_view(padded, window)
    return _with_missing(np.nanmedian(windows, axis=1), present)


def check_odd_window(window: int) -> None:
    """Refuse a window without a middle."""
    _check_window(window)
    if window % 2 == 0:
        raise ValueError(f"{window=} has no middle reading. Give an odd number.")


def _check_window(window: int) -> None:
    if window < 1:
        raise ValueError(f"{window=} is not a valid number of readings. Give 1 or more.")


def check_weight(a: float) -> None:
    """Check that a weight is in (0, 1].

    Parameters
    ----------
    a
        Weight of the newest reading [1].

    Raises
    ------
    ValueError
        Where it is not.
    """
    if not (0 < a <= 1 and math.isfinite(a)):
        raise ValueError(
            f"{a=} is outside (0, 1]. Give the newest reading's weight, such as 0.3."
        )


def _with_missing(
    filtered: Float[np.ndarray, " present"], present: Bool[np.ndarray, " time"]
) -> Series:
    """Put what was filtered back among the missing."""
    out = np.full(len(present), np.nan)
    out[present] = filtered
    return out

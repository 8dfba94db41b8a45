"""Local maxima of a series and their prominences.

They answer as `scipy.signal.find_peaks` and `peak_prominences` do, without `scipy.signal`,
whose import brings SciPy's statistics and interpolation to wherever an edge agent runs.
"""

import numpy as np
from jaxtyping import Float, Int


def local_maxima(series: Float[np.ndarray, " place"]) -> Int[np.ndarray, " peak"]:
    """Find the indices of local maxima; of a flat top its middle, rounded down.

    Parameters
    ----------
    series
        Samples.

    Returns
    -------
    Indices, ascending.

    Examples
    --------
    >>> local_maxima(np.array([0.0, 2.0, 1.0, 3.0, 3.0, 3.0, 0.0, 5.0]))
    array([1, 4])
    """
    if len(series) < 3:
        return np.zeros(0, dtype=np.int64)
    # One byte a place: of a long record there are millions.
    rises, falls = series[1:] > series[:-1], series[1:] < series[:-1]
    sharp = np.flatnonzero(rises[:-1] & falls[1:]) + 1
    level = ~(rises | falls)
    begins = np.flatnonzero(level & ~np.append(False, level[:-1]))
    ends = np.flatnonzero(level & ~np.append(level[1:], False)) + 1
    inside = (begins > 0) & (ends < len(series) - 1)
    begins, ends = begins[inside], ends[inside]
    top = rises[begins - 1] & falls[ends]
    flat = (begins[top] + ends[top]) // 2
    return np.sort(np.concatenate((sharp, flat))).astype(np.int64)


def prominences(
    series: Float[np.ndarray, " place"], peaks: Int[np.ndarray, " peak"]
) -> Float[np.ndarray, " peak"]:
    """Height of each local maximum above the higher of the saddles on either side.

    Parameters
    ----------
    series
        Values, one per place.
    peaks
        All of the series, as `local_maxima` gives them.

    Returns
    -------
    In the unit of the series. The saddle of a side is the lowest place between the peak and
    the next higher one, or the end of the series.

    Examples
    --------
    >>> series = np.array([0.0, 2.0, 1.0, 3.0, 0.5])
    >>> prominences(series, local_maxima(series))
    array([1. , 2.5])
    """
    if len(peaks) == 0:
        return np.zeros(0)
    valleys = np.minimum.reduceat(series, np.append(0, peaks))
    heights = series[peaks].tolist()
    left = _saddles(heights, valleys[:-1].tolist())
    right = _saddles(heights[::-1], valleys[:0:-1].tolist())[::-1]
    return np.asarray(series[peaks] - np.maximum(left, right))


def _saddles(heights: list[float], valleys: list[float]) -> list[float]:
    """Lowest valley between each peak and the last higher one; `valleys[k]` precedes k."""
    found: list[float] = []
    waiting: list[int] = []
    for number, (height, lowest) in enumerate(zip(heights, valleys, strict=True)):
        while waiting and heights[waiting[-1]] <= height:
            lowest = min(lowest, found[waiting.pop()])
        found.append(lowest)
        waiting.append(number)
    return found

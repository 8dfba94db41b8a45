"""Downsampling of a history that keeps its extremes."""

import numpy as np
from jaxtyping import Float, Int

_KEPT_PER_BUCKET = 4


def extremes(
    value: Float[np.ndarray, " time"],
    max_points: int,
    *,
    lo: Float[np.ndarray, " time"] | None = None,
    hi: Float[np.ndarray, " time"] | None = None,
) -> Int[np.ndarray, " kept"]:
    """Pick at most `max_points` readings that show what all of them show; ascending indices.

    The series is cut into buckets of equal count; each keeps the readings where `value` is
    least and greatest, and where `lo` is least and `hi` greatest. First and last are kept, so
    are the extremes of the whole series if `max_points` is at least 6.

    Parameters
    ----------
    value
        The series; NaN entries are passed over unless first or last.
    max_points
        Most readings to keep, at least 2.
    lo, hi
        Ends of the interval about `value`, drawn as a band; by default `value` itself.

    Returns
    -------
    Ascending indices of the readings.

    Examples
    --------
    >>> extremes(np.array([0.0, 9.0, 1.0, -7.0, 1.0, 2.0, 1.0, 0.0]), 6)
    array([0, 1, 3, 7])
    """
    count = len(value)
    if max_points < 2:
        raise ValueError(
            f"{max_points=} leaves no room for the first and the last reading. Give 2 or more."
        )
    if count <= max_points:
        return np.arange(count)
    buckets = (max_points - 2) // _KEPT_PER_BUCKET
    kept = [np.array([0, count - 1])]
    if buckets:
        lo, hi = value if lo is None else lo, value if hi is None else hi
        kept += [_least_of_each(series, buckets) for series in (value, -value, lo, -hi)]
    return np.unique(np.concatenate(kept))


def _least_of_each(
    series: Float[np.ndarray, " time"], buckets: int
) -> Int[np.ndarray, " bucket"]:
    """Index of the least entry in each of `buckets` runs of equal length but the last."""
    length = -(-len(series) // buckets)
    padded = np.full(buckets * length, np.inf)
    padded[: len(series)] = np.where(np.isnan(series), np.inf, series)
    starts = np.arange(buckets) * length
    least = starts + padded.reshape(buckets, length).argmin(axis=1)
    found: Int[np.ndarray, " bucket"] = least[padded[least] < np.inf]
    return found

"""Tables that hold one series, several values a line."""

import numpy as np
from jaxtyping import Float

MIN_ROWS = 24
"""Rows from which the statistics below are computed [1]."""
MAX_VARIANCE_RATIO = 3.0
"""Ratio of the columns' variances up to which they may be parts of one series. Of n rows with
few independent values each, a variance scatters by some tens of percent; channels of one
structure often differ by more."""
MAX_STEP_RATIO = 0.6
"""Mean square step between neighbouring columns over that of unrelated values [1], up to which
the columns follow one another."""
EXCLUDING_VARIANCE_RATIO = 10.0
"""Ratio of the columns' variances [1] beyond which they are no parts of one series."""
MAX_TIME_STEP_RATIO = 1.5
"""Largest step of times over the median step [1], of pairs that are written several a line."""
MAX_SEAM_RATIO = 2.5
"""Step from the end of a line to the next over the steps within a line [1]."""


def looks_wrapped(values: Float[np.ndarray, "row column"]) -> bool:
    """Whether reading along the lines gives one smooth series.

    In a series, the value at the end of a line is followed by that at the beginning of the
    next as closely as values on one line follow each other, and no two neighbours are closer
    than those. In a table of channels, neighbours on one line are of different sensors, and
    each is nearer to its own past.
    """
    rows, width = values.shape
    if rows < MIN_ROWS or width < 3 or not np.isfinite(values).all():
        return False
    variances = values.var(axis=0)
    if not (variances > 0).all() or variances.max() > MAX_VARIANCE_RATIO * variances.min():
        return False
    total = float(values.var())
    within = np.mean(np.diff(values, axis=1) ** 2, axis=0)
    seam = float(np.mean((values[1:, 0] - values[:-1, -1]) ** 2))
    down = float(np.mean(np.diff(values, axis=0) ** 2))
    typical = float(within.mean())
    if typical == 0:
        return False
    return bool(
        typical < MAX_STEP_RATIO * 2 * total
        and 1 / MAX_SEAM_RATIO < seam / typical < MAX_SEAM_RATIO
        and within.max() < MAX_SEAM_RATIO * within.min()
        and typical <= down
    )


def looks_like_channels(values: Float[np.ndarray, "row column"]) -> bool:
    """Whether each column is nearer to its own past than to its neighbours."""
    if len(values) < MIN_ROWS or not np.isfinite(values).all():
        return False
    variances = values.var(axis=0)
    if variances.max() > EXCLUDING_VARIANCE_RATIO * max(float(variances.min()), 1e-300):
        return True
    within = float(np.mean(np.diff(values, axis=1) ** 2))
    down = float(np.mean(np.diff(values, axis=0) ** 2))
    return down < MAX_STEP_RATIO * within


def pairs_of_time_and_value(
    values: Float[np.ndarray, "row column"], tail: tuple[float, ...]
) -> Float[np.ndarray, "time 2"] | None:
    """Return times and values that stand in several pairs a line; None where they do not.

    The times of one line lie between its first and the first of the next.
    """
    rows, width = values.shape
    if rows < 2 or width < 4 or width % 2 or not np.isfinite(values).all():
        return None
    flat = values.reshape(-1, 2)
    if len(tail) % 2 == 0 and tail:
        flat = np.concatenate([flat, np.asarray(tail).reshape(-1, 2)])
    steps = np.diff(flat[:, 0])
    even = (steps > 0).all() and steps.max() <= MAX_TIME_STEP_RATIO * max(
        float(np.median(steps)), 0.0
    )
    return flat if even else None


def unwrap(
    values: Float[np.ndarray, "row column"], tail: tuple[float, ...]
) -> Float[np.ndarray, " value"]:
    """Join one series line by line, with the values of an incomplete last line."""
    return np.concatenate([values.ravel(), np.asarray(tail, dtype=float)])

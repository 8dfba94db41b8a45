"""Samples that repeat the one before, because a reader polled faster than the sensor measures.

Such a record is that of the sensor behind a zero-order hold of uneven length: below half the
sensor's rate it is right, above it stands its image.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

LEAST_ROWS = 64
"""[rows] From which repetition is told from chance. Source: judgement; a sensor at its
resolution repeats a few readings of any short record."""
LEAST_SHARE = 0.02
"""[share of the rows] That repeat the row before, from which a record is held. Source:
judgement; images of a hold lie 34 dB below the signal then."""
REST_RUNS = 8.0
"""[median lengths of a run] From which a run of equal rows is rest, not a hold. Source: a
polling loop on a busy computer stays within three."""
SMALL_STEP = 1.5
"""[resolutions] Up to which a step is the least that can be told. Source: halfway between one
resolution and two."""
FINE_SHARE = 0.3
"""[share of the changes] That may be the least step in every channel. Source: of steps that
are normal with a standard deviation of three resolutions, 0.27 are."""
EVEN_ROWS = 1.5
"""[rows] That the first of equal rows may be from even spacing. Source: polling by an even
clock is within one; half a row is jitter."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Hold:
    """Rows of which some repeat the one before.

    Parameters
    ----------
    first
        Rows that are new, the first of all among them.
    share
        Share of the rows [1] that repeat the one before.
    even
        Whether new rows come at even spacing: the sensor measured evenly, and all is left.
    """

    first: Int[np.ndarray, " new"]
    share: float
    even: bool

    @property
    def ratio(self) -> float:
        """Rows for each new one [1], by a straight line through the new rows."""
        return float(np.polyfit(np.arange(len(self.first)), self.first, 1)[0])


def equal_to_last(columns: Shaped[np.ndarray, "time channel"]) -> Bool[np.ndarray, " time"]:
    """Tell for each row whether it equals the row before in all columns; the first does not.

    Examples
    --------
    >>> equal_to_last(np.array([[1, 2], [1, 2], [1, 3]])).tolist()
    [False, True, False]
    """
    same = (columns[1:] == columns[:-1]).all(axis=1)
    return np.concatenate([[False], same])


def find_hold(
    columns: Float[np.ndarray, "time channel"],
    times: Float[np.ndarray, " time"] | None = None,
) -> Hold | None:
    """Find the repetition of a sensor that is polled faster than it measures.

    Not taken for it are rest (long runs of equal rows), channels against a stop, and steps of
    the resolution: a slow signal of a coarse sensor repeats readings, and changes by one step.

    Parameters
    ----------
    columns
        Samples of all channels, in any unit.
    times
        When each row was read, in any unit; None for even spacing.

    Returns
    -------
    The repetition; None where rows repeat no more than a record of its resolution does.
    """
    if len(columns) < LEAST_ROWS:
        return None
    again = equal_to_last(columns)
    if np.count_nonzero(again) < LEAST_SHARE * len(columns):
        return None
    first = np.flatnonzero(~again)
    lengths = np.diff(np.concatenate([first, [len(columns)]]))
    rest = lengths > REST_RUNS * np.median(lengths)
    stop = _at_extremes(columns[first])
    held = int(np.sum((lengths - 1)[~rest & ~stop]))
    rows = int(np.sum(lengths[~rest & ~stop]))
    if held < LEAST_SHARE * max(rows, LEAST_ROWS) or _coarse(columns[first], held):
        return None
    at = np.arange(float(len(columns))) if times is None else times
    even = not rest.any() and _are_even(at[first], float(np.median(np.diff(at))))
    return Hold(first, float(again.mean()), even)


def _are_even(at: Float[np.ndarray, " new"], step: float) -> bool:
    """Whether instants are on a straight line, to what polling at that step leaves."""
    if len(at) < 3:
        return False
    place = np.arange(len(at))
    line = np.polyval(np.polyfit(place, at - at[0], 1), place)
    return bool(np.abs(at - at[0] - line).max() <= EVEN_ROWS * step)


def _at_extremes(new: Float[np.ndarray, "new channel"]) -> Bool[np.ndarray, " new"]:
    """Tell for each new row whether all moving channels are at their largest or least."""
    moves = np.ptp(new, axis=0) > 0
    if not moves.any():
        return np.ones(len(new), dtype=bool)
    part = new[:, moves]
    return np.asarray(((part == part.max(axis=0)) | (part == part.min(axis=0))).all(axis=1))


def _coarse(new: Float[np.ndarray, "new channel"], held: int) -> bool:
    """Whether changes are so near the resolution that equal rows are to be expected."""
    steps = np.abs(np.diff(new, axis=0))
    if not len(steps):
        return True
    least = np.min(np.where(steps > 0, steps, np.inf), axis=0)
    small = int(np.count_nonzero((steps <= SMALL_STEP * least).all(axis=1)))
    return small > held / 2 or small > FINE_SHARE * len(steps)

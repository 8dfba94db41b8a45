"""Whether readings that fit nothing lie together: another mode in the place of this one."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from .history import Series

_SIDE = 9  # readings on either side, whose medians a reading is compared with
_AROUND = 25  # readings on either side that tell the level when it is known where it is not
_FAR = 8.0  # noise sds from both medians, beyond which a reading fits nothing
_TIGHT = 6.0  # noise sds within which such readings count as one place
_FEWEST = 5
_ODDS = 7.0  # log-odds of being together by another reason than chance


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Swap:
    """Readings of another mode.

    Parameters
    ----------
    which
        They.
    offset, sd
        How far the other mode is away, and how well that is known; scaled.
    """

    which: Bool[np.ndarray, " time"]
    offset: float
    sd: float


def swapped(residual: Series) -> Swap | None:
    """Find readings that leave their neighbours on both sides, to one and the same place.

    Outliers proper may lie anywhere in the range that they span; that most of them lie in one
    narrow place of it has a binomial probability, which is the test.

    Parameters
    ----------
    residual
        Readings without what follows the covariates, ascending in time. Steps and teeth may
        be in them: they have a side to agree with.
    """
    noise = 1.4826 * float(np.median(np.abs(np.diff(residual)))) / np.sqrt(2.0)
    before, after = residual - _earlier(residual), residual - _earlier(residual[::-1])[::-1]
    far = (np.minimum(np.abs(before), np.abs(after)) > _FAR * noise) & (before * after > 0.0)
    offsets = 0.5 * (before + after)[far]
    count = len(offsets)
    if count < _FEWEST:
        return None
    width = _TIGHT * noise
    inside = np.abs(offsets[:, None] - offsets[None, :]) <= 0.5 * width
    best = inside[int(inside.sum(axis=1).argmax())]
    together = int(best.sum())
    reach = max(2.0 * float(np.abs(offsets).max()), 2.0 * width)
    if together < _FEWEST or _log_odds(together, count, min(width / reach, 0.5)) < _ODDS:
        return None
    centre = float(np.mean(offsets[best]))
    which = far & (np.abs(0.5 * (before + after) - centre) <= width)
    # Where they are the most for a while, only the level farther around tells them.
    for _ in range(2):
        away = residual - _level(residual, ~which)
        which = np.abs(away - centre) <= width
    spread = float(np.std(offsets[best])) / np.sqrt(together)
    return Swap(which, centre, spread)


def _log_odds(together: int, count: int, share: float) -> float:
    """Of so many of a count lying in one place rather than by a share that chance gives it."""
    apart = count - together
    by_chance = together * np.log(share) + apart * np.log1p(-share)
    as_seen = together * np.log(together / count)
    if apart:
        as_seen += apart * np.log(apart / count)
    return float(as_seen - by_chance - np.log(count))


def _level(residual: Series, known: Bool[np.ndarray, " time"]) -> Series:
    """Median of the readings around each that are not known to be wrong."""
    places = np.searchsorted(np.flatnonzero(known), np.arange(len(residual)))
    right = residual[known]
    ends = np.clip(places[:, None] + np.array([-_AROUND, _AROUND]), 0, len(right))
    level: Series = np.array([np.median(right[first:last]) for first, last in ends])
    return level


def _earlier(residual: Series) -> Float[np.ndarray, " time"]:
    """Median of the readings just before each; of the first ones, of what comes after."""
    padded = np.concatenate([residual[_SIDE:0:-1], residual[:-1]])
    windows = np.lib.stride_tricks.sliding_window_view(padded, _SIDE)
    medians: Float[np.ndarray, " time"] = np.median(windows, axis=1)
    return medians

"""Detection of readings that belong to another mode of the structure."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from .history import Series

_NEIGHBOURS = 9
"""[readings] On either side, with whose median a reading is compared. Source:
docs/what_decides.md: half and double change no answer."""
_LEVEL_NEIGHBOURS = 25
"""[readings] On either side, of those not suspected, from which the level is taken once the
offset of the other mode is known. Source: docs/what_decides.md: half and double change no
answer."""
_FAR_SDS = 8.0
"""[noise standard deviations] From the medians of both sides, beyond which a reading is
suspected. Source: docs/what_decides.md: half and double change no answer."""
_CLUSTER_SDS = 6.0
"""[noise standard deviations] Width of a cluster. Source: three-sigma rule, to either side."""
_FEWEST_SWAPPED = 5
"""[readings] Fewest that form a cluster. Source: docs/what_decides.md: half and double change
no answer."""
_LEAST_LOG_ODDS = 7.0
"""[nats] Of a cluster against chance: odds of 1100 to 1. Source: docs/what_decides.md: half and
double change no answer."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ModeSwap:
    """Readings of another mode."""

    which: Bool[np.ndarray, " time"]
    offset: float
    sd: float


def find_mode_swap(residual: Series) -> ModeSwap | None:
    """Find readings that leave their neighbours on both sides by one and the same offset.

    Ordinary outliers may lie anywhere in the range that they span. The test is the binomial
    log-likelihood ratio that most of them lie in one narrow part of it. Residuals are ascending
    in time; steps and sawteeth in them agree with their neighbours on one side.
    """
    noise = 1.4826 * float(np.median(np.abs(np.diff(residual)))) / np.sqrt(2.0)
    before = residual - _median_before(residual)
    after = residual - _median_before(residual[::-1])[::-1]
    far = np.minimum(np.abs(before), np.abs(after)) > _FAR_SDS * noise
    far &= before * after > 0.0
    offset = 0.5 * (before + after)
    offsets = offset[far]
    count = len(offsets)
    if count < _FEWEST_SWAPPED:
        return None
    width = _CLUSTER_SDS * noise
    inside = np.abs(offsets[:, None] - offsets[None, :]) <= 0.5 * width
    best = inside[int(inside.sum(axis=1).argmax())]
    together = int(best.sum())
    reach = max(2.0 * float(np.abs(offsets).max()), 2.0 * width)
    log_odds = _log_odds(together, count, min(width / reach, 0.5))
    if together < _FEWEST_SWAPPED or log_odds < _LEAST_LOG_ODDS:
        return None
    centre = float(np.mean(offsets[best]))
    which = far & (np.abs(offset - centre) <= width)
    # Where swapped readings are the majority for a while, only the level farther out tells.
    for _ in range(2):
        which = np.abs(residual - _level(residual, ~which) - centre) <= width
    spread = float(np.std(offsets[best])) / np.sqrt(together)
    return ModeSwap(which, centre, spread)


def _log_odds(together: int, count: int, share: float) -> float:
    """Log-likelihood ratio of a cluster against a binomial of the given share, per place."""
    apart = count - together
    by_chance = together * np.log(share) + apart * np.log1p(-share)
    as_seen = together * np.log(together / count)
    if apart:
        as_seen += apart * np.log(apart / count)
    return float(as_seen - by_chance - np.log(count))


def _level(residual: Series, known: Bool[np.ndarray, " time"]) -> Series:
    """Median of the readings around each that are not suspected."""
    places = np.searchsorted(np.flatnonzero(known), np.arange(len(residual)))
    right = residual[known]
    sides = np.array([-_LEVEL_NEIGHBOURS, _LEVEL_NEIGHBOURS])
    ends = np.clip(places[:, None] + sides, 0, len(right))
    level: Series = np.array([np.median(right[first:last]) for first, last in ends])
    return level


def _median_before(residual: Series) -> Float[np.ndarray, " time"]:
    """Median of the readings just before each, reflected at the start."""
    padded = np.concatenate([residual[_NEIGHBOURS:0:-1], residual[:-1]])
    windows = np.lib.stride_tricks.sliding_window_view(padded, _NEIGHBOURS)
    medians: Float[np.ndarray, " time"] = np.median(windows, axis=1)
    return medians

"""Whether readings that fit nothing lie together: another mode in the place of this one."""

import numpy as np
from jaxtyping import Bool

from .model import SlowModel, fitted

_FEWEST = 5
_TIGHT = 6.0  # noise sds within which they count as one place
_ODDS = 7.0  # log-odds of being together by another reason than chance


def swapped(model: SlowModel) -> Bool[np.ndarray, " time"]:
    """Which unused readings share an offset from what was expected of them.

    Outliers proper may lie anywhere in the range that they span; that most of them lie in one
    narrow place of it has a binomial probability, which is the test.
    """
    readings, away = model.readings, fitted(model)[0]
    out = ~readings.mask
    found = np.zeros(len(out), dtype=bool)
    if out.sum() < _FEWEST:
        return found
    offsets = away[out]
    width = _TIGHT * float(np.median(np.sqrt(readings.variance)))
    inside = np.abs(offsets[:, None] - offsets[None, :]) <= 0.5 * width
    best = int(inside.sum(axis=1).argmax())
    together, count = int(inside[best].sum()), len(offsets)
    reach = max(float(np.abs(offsets).max()) * 2.0, 2.0 * width)
    share = min(width / reach, 0.5)
    chance = together * np.log(share) + (count - together) * np.log1p(-share)
    expected = together * np.log(together / count)
    if together < count:
        expected += (count - together) * np.log(1.0 - together / count)
    if together >= _FEWEST and expected - chance - np.log(count) > _ODDS:
        found[np.flatnonzero(out)[inside[best]]] = True
    return found

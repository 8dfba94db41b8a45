"""Several modes of one structure: what they do together, and what one of them does alone.

Physics moves all modes, more or less; a sensor or a mix-up moves one. So the mean of the modes
is diagnosed, and each mode is asked whether it leaves the others at once.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from .history import History, Series, history, scaled
from .kinds import kinds
from .law import Readings
from .outliers import agreeing
from .search import contest

_SURE = 0.99
_NEAR = 0.05  # of the history, within which two steps are the same


@dataclasses.dataclass(frozen=True, slots=True)
class Departure:
    """One mode that left the others: which, when, by how much, and how surely."""

    mode: int
    time: float
    offset: float
    probability: float


def together(
    value: Float[np.ndarray, "time mode"], sd: Float[np.ndarray, "time mode"]
) -> tuple[Series, Series]:
    """Mean of the modes that were read at each epoch, each about its own median."""
    weight = 1.0 / np.nanmedian(np.where(sd > 0.0, sd, np.nan), axis=0) ** 2
    level = np.nanmedian(value, axis=0)
    known = np.isfinite(value) & np.isfinite(sd)
    weights = np.where(known, weight, 0.0)
    total = np.maximum(weights.sum(axis=1), 1e-300)
    away = np.where(known, value - level, 0.0)
    centre = float(level @ (weight / weight.sum()))
    mean = centre + (weights * away).sum(axis=1) / total
    spread = np.sqrt((weights**2 * np.where(known, sd, 0.0) ** 2).sum(axis=1)) / total
    lost = ~known.any(axis=1)
    return np.where(lost, np.nan, mean), np.where(lost, np.nan, spread)


def departure(
    slow_time: Series, value: Float[np.ndarray, "time mode"], sd: Float[np.ndarray, "time mode"]
) -> Departure | None:
    """Find the mode that steps away while the others do not step."""
    count = value.shape[1]
    found = []
    for mode in range(count):
        rest = [other for other in range(count) if other != mode]
        others, others_sd = together(value[:, rest], sd[:, rest])
        away = _step(slow_time, value[:, mode] - others, np.hypot(sd[:, mode], others_sd))
        if away is None:
            continue
        span = float(np.ptp(slow_time))
        theirs = _step(slow_time, others, others_sd)
        if theirs is not None and abs(theirs[0] - away[0]) < _NEAR * span:
            continue
        found.append(Departure(mode, *away))
    return max(found, key=lambda one: (one.probability, abs(one.offset)), default=None)


def without(
    values: Float[np.ndarray, "time mode"], gone: Departure
) -> Float[np.ndarray, "time rest"]:
    """Leave out the mode that departed."""
    rest: Float[np.ndarray, "time rest"] = np.delete(values, gone.mode, axis=1)
    return rest


def _step(slow_time: Series, value: Series, sd: Series) -> tuple[float, float, float] | None:
    """Time, size and probability of a step, if there is one."""
    past: History = history(slow_time, value, sd)
    inner = scaled(past)
    none = np.zeros(len(inner.time), dtype=bool)
    mask = agreeing(inner, np.empty((len(inner.time), 0)), none)
    readings = Readings(inner, mask, inner.sd**2, none)
    alone = tuple(kind for kind in kinds(inner, "") if kind.family in ("step", "drift"))
    best = contest(readings, alone, ()).by_name()[0]
    name, _, probability, option = best
    if name != "step" or probability < _SURE:
        return None
    at = option.fit.terms[-1].shape[0]
    after = inner.time >= at
    size = float(np.median(inner.value[after]) - np.median(inner.value[~after]))
    return inner.start + inner.span * at, inner.scale * size, probability

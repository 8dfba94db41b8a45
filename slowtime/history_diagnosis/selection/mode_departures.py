"""Average of several modes, and detection of one mode that steps away from the others.

A change of the structure moves all modes; a fault of a sensor or of mode tracking moves one.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.history_diagnosis.data.history import Series, checked_history, scale_history
from slowtime.history_diagnosis.laws.catalogue import candidate_laws
from slowtime.history_diagnosis.laws.terms import ScreenedHistory

from .forward_selection import compare_laws
from .outliers import inlier_mask

_CERTAIN = 0.99
"""[probability] Of a step, from which a mode counts as departed. Source: docs/what_decides.md:
half and double change no answer."""
_SAME_TIME = 0.05
"""[histories] Within which two steps are one. Source: docs/what_decides.md: half and double
change no answer."""


@dataclasses.dataclass(frozen=True, slots=True)
class ModeDeparture:
    """A mode that stepped away from the others."""

    mode: int
    time: float
    offset: float
    probability: float


def mode_average(
    value: Float[np.ndarray, "time mode"], sd: Float[np.ndarray, "time mode"]
) -> tuple[Series, Series]:
    """Return the weighted mean of the modes read at each epoch, and its standard deviation.

    Each mode is averaged about its own median, with the inverse of its median variance as
    weight; values are NaN where missing.
    """
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


def find_departure(
    slow_time: Series, value: Float[np.ndarray, "time mode"], sd: Float[np.ndarray, "time mode"]
) -> ModeDeparture | None:
    """Find the mode that steps away while the others do not step."""
    found = []
    for mode in range(value.shape[1]):
        others, others_sd = mode_average(
            np.delete(value, mode, axis=1), np.delete(sd, mode, axis=1)
        )
        away = _step(slow_time, value[:, mode] - others, np.hypot(sd[:, mode], others_sd))
        if away is None:
            continue
        theirs = _step(slow_time, others, others_sd)
        near = _SAME_TIME * float(np.ptp(slow_time))
        if theirs is None or abs(theirs[0] - away[0]) >= near:
            found.append(ModeDeparture(mode, *away))
    return max(found, key=lambda one: (one.probability, abs(one.offset)), default=None)


def _step(slow_time: Series, value: Series, sd: Series) -> tuple[float, float, float] | None:
    """Time, size and probability of a step, if there is one."""
    inner = scale_history(checked_history(slow_time, value, sd))
    none = np.zeros(len(inner.time), dtype=bool)
    mask = inlier_mask(inner, np.empty((len(inner.time), 0)), none)
    readings = ScreenedHistory(inner, mask, inner.sd**2, none)
    laws = tuple(law for law in candidate_laws(inner, "") if law.family in ("step", "drift"))
    best = compare_laws(readings, laws, ()).by_name()[0]
    if best.name != "step" or best.probability < _CERTAIN:
        return None
    at = best.best.fit.terms[-1].shape[0]
    after = inner.time >= at
    size = float(np.median(inner.value[after]) - np.median(inner.value[~after]))
    return inner.start + inner.span * at, inner.scale * size, best.probability

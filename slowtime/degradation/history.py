"""Readings of one quantity with the events between them, in scaled units."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

Series = Float[np.ndarray, " time"]

FEWEST = 5
"""Readings below which no law is learnt [1]: more than the parameters of the richest law."""

LEVEL_WIDTH = 10.0
"""Prior sd of a level, and of the change over the history, over the scatter of the readings
[1]; the value of `hyperparameters.weak_prior`, so that evidences can be compared."""


@dataclasses.dataclass(frozen=True, slots=True)
class KnownChange:
    """A known change of the asset between two readings.

    Parameters
    ----------
    time
        Slow time of the event.
    restored
        Share of the accumulated age that a repair takes away: 0 for a jump of the level only,
        1 for a perfect repair (virtual age, Kijima II) [1].
    sd
        Standard deviation of the shift of the level that comes with the event, in the unit of
        the readings; 0 where the level only changes through the age.
    """

    time: float
    restored: float = 0.0
    sd: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a share outside 0 to 1 and a negative spread."""
        if not 0.0 <= self.restored <= 1.0 or not self.sd >= 0.0 or not np.isfinite(self.time):
            raise ValueError(
                f"{self} is not a valid event. Give a finite time, a restored "
                "share from 0 to 1, and a "
                "standard deviation that is not negative."
            )


@dataclasses.dataclass(frozen=True, slots=True)
class History:
    """Readings in ascending order of slow time, and the scales in which laws see them.

    Parameters
    ----------
    events
        Known jumps and repairs, in ascending order of time.
    origin
        Slow time at which the age is zero.
    span
        Unit of scaled time: slow time from the origin to the last reading.
    centre, scatter
        Mean of the readings and their standard deviation, in the unit of the readings.
    """

    time: Series
    value: Series
    sd: Series
    events: tuple[KnownChange, ...]
    origin: float
    span: float
    centre: float
    scatter: float

    def age(self, time: Float[np.ndarray, " any"]) -> Float[np.ndarray, " any"]:
        """Virtual age at slow times, relative to the span."""
        age = time - self.origin
        removed = 0.0
        for event in self.events:
            taken = event.restored * (event.time - self.origin - removed)
            age = age - np.where(time > event.time, taken, 0.0)
            removed += taken
        return np.asarray(age / self.span)

    def steps(self, time: Float[np.ndarray, " any"]) -> Float[np.ndarray, "any step"]:
        """Step functions of events that shift the level: 0 before an event and 1 after it."""
        places = [event.time for event in self.events if event.sd > 0.0]
        return np.asarray(time[:, None] > np.array(places), dtype=float)

    @property
    def step_sds(self) -> Float[np.ndarray, " step"]:
        """Prior standard deviation of each of these shifts, in the unit of the readings."""
        return np.array([event.sd for event in self.events if event.sd > 0.0])

    @property
    def rough(self) -> float:
        """Standard deviation of the readings about a parabola, in their unit."""
        design = np.vander((self.time - self.origin) / self.span, 3)
        left = self.value - design @ np.linalg.lstsq(design, self.value, rcond=None)[0]
        return max(float(np.std(left)), 1e-6 * self.scatter)

    @property
    def slope(self) -> tuple[float, float]:
        """Weighted least-squares change over one span, and its standard deviation."""
        weight = 1.0 / self.sd**2
        s = (self.time - self.origin) / self.span
        middle = float(weight @ s / weight.sum())
        information = max(float(weight @ (s - middle) ** 2), 1e-300)
        level = float(weight @ self.value / weight.sum())
        slope = float(weight @ ((s - middle) * (self.value - level))) / information
        return slope, information**-0.5


def history_of(
    time: Series,
    value: Series,
    sd: Series,
    *,
    events: Sequence[KnownChange] = (),
    origin: float | None = None,
) -> History:
    """Sort the usable readings by time, and compute their scales.

    Entries that are not finite are missing. The age is zero at `origin`, by default the first
    reading. Raises `ValueError` where fewer than `FEWEST` readings are left, or all are at one
    time.
    """
    usable = np.isfinite(time) & np.isfinite(value) & np.isfinite(sd) & (sd >= 0.0)
    order = np.argsort(time[usable], kind="stable")
    t, v, s = (np.asarray(one[usable][order], dtype=float) for one in (time, value, sd))
    if len(t) < FEWEST or not t[-1] > t[0]:
        raise ValueError(
            f"{len(t)} readings, or all at one time, are too few to learn a degradation law "
            f"from. Give at least {FEWEST} readings at different times."
        )
    start = t[0] if origin is None else float(origin)
    if start > t[0]:
        raise ValueError(
            f"origin={start:g} is after the first reading at {t[0]:g}. Give the slow time at "
            "which the asset was new, no later than its first reading."
        )
    scatter = max(float(np.std(v)), 1e-12 * (1e-300 + float(np.abs(v).max())))
    known = tuple(sorted(events, key=lambda event: event.time))
    s = np.maximum(s, 1e-6 * scatter)
    return History(t, v, s, known, start, float(t[-1] - start), float(np.mean(v)), scatter)

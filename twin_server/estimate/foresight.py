"""Where a twin is heading: its states in, bands over future slow times out."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float
from pydantic_core import from_json

from slowtime.evolution import forecast
from slowtime.evolution.crossing import Crossing, first_crossing
from twin_server.details import Bodies
from twin_server.states import ASSUMES_MASS, ASSUMES_STIFFNESS, States
from twin_server.thresholds import Limit

from .checkpoint import Known
from .estimator import LEVEL
from .memory import Memory

FEWEST = 10
"""Valid readings below which nothing is forecast."""

MOST = 400
"""Readings a forecast is made from; of a longer history, the newest."""

MOST_OF_ELEMENTS = 150
"""Likewise of a twin of elements, each of which has a forecast of its own."""

_GAP = {"value": math.nan, "sd": math.nan}

Outlooks: TypeAlias = dict[str, forecast.Outlook]

_PATHS, _POINTS = 2000, 120


@dataclasses.dataclass(frozen=True, slots=True)
class Foresight:
    """What is expected of a twin.

    Parameters
    ----------
    since, slow_time
        Slow time of the last reading, and the future ones.
    bands
        For each quantity that is estimated: value, sd, lo and hi at each of them.
    until
        Slow time up to which readings inform the forecast; beyond, it repeats the trend.
    outlooks
        What was learnt for it, for the next time.
    reasons
        Why it should not be relied on; none where it can.
    crossings
        When each threshold that was asked for is reached.
    """

    since: float
    slow_time: Float[np.ndarray, " later"]
    bands: dict[str, Float[np.ndarray, "later 4"]]
    until: float
    outlooks: Outlooks
    reasons: tuple[str, ...]
    crossings: tuple[tuple[Limit, Crossing], ...] = ()


class Past(NamedTuple):
    """One quantity up to now.

    Parameters
    ----------
    value, sd
        A change, and its standard deviation [1].
    common
        Part of the error that all readings share, over 1 + change, so that no number of
        readings averages it out.
    """

    slow_time: Float[np.ndarray, " time"]
    value: Float[np.ndarray, " time"]
    sd: Float[np.ndarray, " time"]
    common: float

    @property
    def own_sd(self) -> Float[np.ndarray, " time"]:
        """Part of the standard deviation that each reading has by itself."""
        shared = self.common * np.abs(1.0 + self.value)
        return np.sqrt(np.maximum(self.sd**2 - shared**2, (0.1 * self.sd) ** 2))


def past_of(states: States, known: Known | None) -> dict[str, Past]:
    """Take the changes of a twin of one mode that are estimated, from its valid states."""
    used = states[states["reasons"] == 0][-MOST:]
    if known is None or not len(used):
        return {}
    time, common = np.ascontiguousarray(used["slow_time"]), 2.0 * known.frequency_relative_sd
    past = {}
    for name in _estimated(used):
        value, sd, _, _ = np.ascontiguousarray(used[name].T)
        past[name] = Past(time, value, sd, common)
    return past


def past_of_elements(states: States, bodies: Bodies, memory: Memory | None) -> dict[str, Past]:
    """Take the changes of each parameter of a twin of elements from its valid states."""
    if memory is None or not bodies:
        return {}
    rows = [row for row in np.flatnonzero(states["reasons"] == 0).tolist() if bodies[row]]
    rows = rows[-MOST_OF_ELEMENTS:]
    told = [from_json(bodies[row] or b"")["elements"] for row in rows]
    time = np.ascontiguousarray(states["slow_time"][rows])
    past = {}
    for name in told[-1] if told else ():
        each = [one.get(name, _GAP) for one in told]
        value, sd = np.array([(one["value"], one["sd"]) for one in each]).T.copy()
        relative = float(np.nanmedian(sd / (1.0 + value)))
        past[name] = Past(time, value, sd, math.sqrt(memory.common_share) * relative)
    return past


def learn(
    past: Mapping[str, Past],
    process: forecast.Choice = "evidence",
    suspected: Mapping[str, Sequence[float]] | None = None,
) -> Outlooks:
    """Learn from the past of each quantity what it may do; empty where that is too little.

    `suspected` are slow times of each after which it was seen to jump.
    """
    jumps = suspected or {}
    if not _is_enough(past):
        return {}
    return {
        name: forecast.fit(
            one.slow_time, one.value, one.own_sd, process=process, suspected=jumps.get(name, ())
        )
        for name, one in past.items()
    }


def foresee(
    past: Mapping[str, Past],
    outlooks: Outlooks,
    horizon: float | None,
    count: int,
    thresholds: Sequence[Limit] = (),
) -> Foresight | None:
    """Forecast each quantity; None where there is too little to go by.

    Parameters
    ----------
    past
        Of each, its history, oldest first; all at the same slow times.
    outlooks
        What `learn` has learnt, from this past or from an earlier one.
    horizon
        How far ahead, in slow time; None for a quarter of the history that is used, and for
        thresholds all of it.
    count
        At how many future times.
    thresholds
        Of which it is asked when they are reached.
    """
    if not _is_enough(past) or not set(past) <= set(outlooks):
        return None
    time = next(iter(past.values())).slow_time
    since, span = float(time.max()), float(np.ptp(time))
    later = since + (horizon or 0.25 * span) * np.arange(1, count + 1) / count
    bands: dict[str, Float[np.ndarray, "later 4"]] = {}
    until = np.inf
    for name, one in past.items():
        ahead = forecast.predict(
            outlooks[name], time, one.value, one.own_sd, later, level=LEVEL
        )
        widened = np.hypot(ahead.sd, one.common * np.abs(1.0 + ahead.mean))
        wider = widened / np.where(ahead.sd > 0, ahead.sd, 1.0)
        lo, hi = (ahead.mean + (end - ahead.mean) * wider for end in (ahead.lo, ahead.hi))
        bands[name] = np.column_stack((ahead.mean, widened, lo, hi))
        until = min(until, ahead.horizon)
    reasons: tuple[str, ...] = ()
    if later[-1] > until:
        reasons = (
            f"Beyond slow time {until:.6g} the readings say little: the forecast repeats its "
            "trend there. Ask for a shorter horizon, or wait for more readings.",
        )
    crossings = tuple(
        (limit, _crossing(past[limit.quantity], outlooks, limit, since + (horizon or span)))
        for limit in thresholds
        if limit.quantity in past
    )
    used = {name: outlooks[name] for name in past}
    return Foresight(since, later, bands, float(until), used, reasons, crossings)


def now_of(past: Mapping[str, Past], outlooks: Outlooks) -> dict[str, tuple[float, float]]:
    """Mean and sd of each change at its last reading, given all readings."""
    found: dict[str, tuple[float, float]] = {}
    if not _is_enough(past):
        return found
    for name, one in past.items():
        if name in outlooks:
            since = np.array([one.slow_time.max()])
            here = forecast.predict(
                outlooks[name], one.slow_time, one.value, one.own_sd, since, level=LEVEL
            )
            mean = float(here.mean[0])
            sd = math.hypot(float(here.sd[0]), one.common * abs(1.0 + mean))
            found[name] = mean, sd
    return found


def _crossing(one: Past, outlooks: Outlooks, limit: Limit, horizon: float) -> Crossing:
    return first_crossing(
        outlooks[limit.quantity],
        one.slow_time,
        one.value,
        one.own_sd,
        limit.at,
        horizon,
        toward=limit.toward,
        common_sd=one.common * abs(1.0 + limit.at),
        points=_POINTS,
        paths=_PATHS,
    )


def _is_enough(past: Mapping[str, Past]) -> bool:
    time = next((one.slow_time for one in past.values()), np.zeros(0))
    return len(time) >= FEWEST and bool(np.ptp(time) > 0)


def _estimated(states: States) -> list[str]:
    notes = int(states["notes"][-1])
    bits = {"stiffness_change": ASSUMES_STIFFNESS, "mass_change": ASSUMES_MASS}
    return [name for name, bit in bits.items() if not notes & bit]

"""Where a twin is heading: its states in, bands over future slow times out."""

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float
from pydantic_core import from_json

from slowtime.evolution import forecast
from twin_server.details import Bodies
from twin_server.states import ASSUMES_MASS, ASSUMES_STIFFNESS, States

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
    """

    since: float
    slow_time: Float[np.ndarray, " later"]
    bands: dict[str, Float[np.ndarray, "later 4"]]
    until: float
    outlooks: Outlooks
    reasons: tuple[str, ...]


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


def foresee(
    past: Mapping[str, Past],
    horizon: float | None,
    count: int,
    outlooks: Outlooks | None = None,
) -> Foresight | None:
    """Forecast each quantity; None where there is too little to go by.

    Parameters
    ----------
    past
        Of each, its history, oldest first; all at the same slow times.
    horizon
        How far ahead, in slow time; None for a quarter of the history that is used.
    count
        At how many future times.
    outlooks
        What an earlier forecast has learnt from nearly the same history.
    """
    time = next((one.slow_time for one in past.values()), np.zeros(0))
    if len(time) < FEWEST or not np.ptp(time) > 0:
        return None
    since = float(time.max())
    reach = 0.25 * float(np.ptp(time)) if horizon is None else horizon
    later = since + reach * np.arange(1, count + 1) / count
    learnt: Outlooks = {}
    bands: dict[str, Float[np.ndarray, "later 4"]] = {}
    until = np.inf
    for name, one in past.items():
        common = one.common * np.abs(1.0 + one.value)
        own = np.sqrt(np.maximum(one.sd**2 - common**2, (0.1 * one.sd) ** 2))
        outlook = (outlooks or {}).get(name) or forecast.fit(time, one.value, own)
        ahead = forecast.predict(outlook, time, one.value, own, later, level=LEVEL)
        widened = np.hypot(ahead.sd, one.common * np.abs(1.0 + ahead.mean))
        half = (ahead.hi - ahead.mean) * widened / np.where(ahead.sd > 0, ahead.sd, 1.0)
        bands[name] = np.column_stack(
            (ahead.mean, widened, ahead.mean - half, ahead.mean + half)
        )
        learnt[name] = outlook
        until = min(until, ahead.horizon)
    reasons: tuple[str, ...] = ()
    if later[-1] > until:
        reasons = (
            f"Beyond slow time {until:.6g} the readings say little: the forecast repeats its "
            "trend there. Ask for a shorter horizon, or wait for more readings.",
        )
    return Foresight(since, later, bands, float(until), learnt, reasons)


def _estimated(states: States) -> list[str]:
    notes = int(states["notes"][-1])
    bits = {"stiffness_change": ASSUMES_STIFFNESS, "mass_change": ASSUMES_MASS}
    return [name for name, bit in bits.items() if not notes & bit]

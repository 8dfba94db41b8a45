"""Where a twin is heading: its states in, bands over future slow times out."""

import dataclasses
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from slowtime.evolution import forecast
from twin_server.states import ASSUMES_MASS, ASSUMES_STIFFNESS, States

from .checkpoint import Known
from .estimator import LEVEL

FEWEST = 10
"""Valid readings below which nothing is forecast."""

MOST = 400
"""Readings a forecast is made from; of a longer history, the newest."""

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


def foresee(
    states: States,
    known: Known | None,
    horizon: float | None,
    count: int,
    outlooks: Outlooks | None = None,
) -> Foresight | None:
    """Forecast the quantities that are estimated; None where there is too little to go by.

    Parameters
    ----------
    states
        History, oldest first.
    known
        The nominal model; its error is the same in all readings, so that no number of them
        averages it out.
    horizon
        How far ahead, in slow time; None for a quarter of the history that is used.
    count
        At how many future times.
    outlooks
        What an earlier forecast has learnt from nearly the same history.
    """
    used = states[states["reasons"] == 0][-MOST:]
    if len(used) < FEWEST or known is None or not np.ptp(used["slow_time"]) > 0:
        return None
    since = float(used["slow_time"].max())
    reach = 0.25 * float(np.ptp(used["slow_time"])) if horizon is None else horizon
    later = since + reach * np.arange(1, count + 1) / count
    learnt: Outlooks = {}
    bands: dict[str, Float[np.ndarray, "later 4"]] = {}
    until = np.inf
    for name in _estimated(used):
        value, total, _, _ = np.ascontiguousarray(used[name].T)
        common = _common_error(known, value)
        own = np.sqrt(np.maximum(total**2 - common**2, (0.1 * total) ** 2))
        time = np.ascontiguousarray(used["slow_time"])
        outlook = (outlooks or {}).get(name) or forecast.fit(time, value, own)
        ahead = forecast.predict(outlook, time, value, own, later, level=LEVEL)
        widened = np.hypot(ahead.sd, _common_error(known, ahead.mean))
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


def _common_error(
    known: Known, change: Float[np.ndarray, " time"]
) -> Float[np.ndarray, " time"]:
    """Part of a change's error that comes from the nominal frequency alone."""
    error: Float[np.ndarray, " time"] = 2.0 * known.frequency_relative_sd * np.abs(1.0 + change)
    return error

"""Forecasts the changes of a twin: bands over future slow times, and crossing times."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float
from pydantic_core import from_json

from slowtime import degradation
from slowtime.degradation import STANDARD, GaussianLaw, Mixture, RemainingLife
from slowtime.degradation.gaussian import NAME as GAUSSIAN
from slowtime.degradation.gaussian import GaussianPosterior
from slowtime.evolution.events.known_events import KnownEvent, Repair, Replacement, is_jump
from slowtime.evolution.forecasting import continuation, forecast
from slowtime.evolution.forecasting.continuation import Continuation
from slowtime.evolution.life.threshold_crossing import SampledFutures
from slowtime_schemas.slow_times import time_in_words
from twin_server.estimate.checkpoint import NominalInUse
from twin_server.estimate.elements.memory import ElementMemory
from twin_server.estimate.estimator import LEVEL
from twin_server.history.details import Bodies
from twin_server.history.states import (
    ASSUMES_MASS,
    ASSUMES_STIFFNESS,
    States,
    covered_share,
    sd_factor,
)
from twin_server.registration.thresholds import Limit

from .futures import futures_of
from .known_events import KnownEvents

FEWEST = 10
"""Valid readings below which nothing is forecast."""

MOST = 400
"""Readings a forecast is made from; of a longer history, the newest."""

MOST_OF_ELEMENTS = 150
"""Likewise of a twin of elements, each of which has a forecast of its own."""

_GAP = {"value": math.nan, "sd": math.nan}


class LearntLaw(NamedTuple):
    """Laws learnt of one quantity.

    Parameters
    ----------
    outlook
        Gaussian processes with their weights: bands follow them.
    laws
        Degradation laws with their weights, these processes among them: remaining life follows
        from them.
    """

    outlook: forecast.Outlook
    laws: Mixture


LearntLaws: TypeAlias = dict[str, LearntLaw]


@dataclasses.dataclass(frozen=True, slots=True)
class ChangeForecast:
    """Forecast of the changes of a twin.

    Parameters
    ----------
    since, horizon
        Slow time of the last reading, and the latest that is looked at.
    slow_time
        Future slow times.
    bands
        For each quantity that is estimated: value, sd, lo and hi at each of them.
    until
        Slow time up to which readings inform the forecast, see `_informed_until`.
    outlooks
        What was learnt for it, for the next time.
    reasons
        Why it should not be relied on; none where it can.
    crossings
        When each threshold that was asked for is reached, by all degradation laws together.
    misfits
        Of each quantity that no degradation law fits, a sentence that says so.
    widening
        Factor by which the futures of each are spread wider, see `ForecastState`.
    """

    since: float
    horizon: float
    slow_time: Float[np.ndarray, " later"]
    bands: dict[str, Float[np.ndarray, "later 4"]]
    until: float
    outlooks: LearntLaws
    reasons: tuple[str, ...]
    crossings: tuple[tuple[Limit, RemainingLife], ...] = ()
    misfits: tuple[str, ...] = ()
    widening: Mapping[str, float] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, slots=True)
class ForecastState:
    """State from which a forecast is made; its size does not grow with the readings.

    Parameters
    ----------
    begun, laws, common
        Of each quantity, its outlook with what is believed after the last reading, likewise its
        degradation laws, and `Past.common` as it was when that was learnt.
    first, since
        Slow times of the first reading that is used, and of the last.
    widening
        Factor by which the futures of each are spread wider, as its past outlooks were too
        sure; 1 where none is given (`statements`).
    """

    begun: Mapping[str, Continuation]
    laws: Mapping[str, Mixture]
    common: Mapping[str, float]
    first: float
    since: float
    widening: Mapping[str, float] = dataclasses.field(default_factory=dict)

    def futures(self, name: str, horizon: float) -> SampledFutures:
        """Draw the futures of one quantity, of which everything told is a view."""
        widening = self.widening.get(name, 1.0)
        return futures_of(self.laws[name], self.common[name], horizon, widening)


class Past(NamedTuple):
    """One quantity up to now.

    Parameters
    ----------
    value, sd
        A change, and its standard deviation [1].
    common
        Part of the error that all readings share, over 1 + change, so that no number of
        readings averages it out.
    factor
        Factor of the independent part where windows overlap, see `sd_factor` [1].
    """

    slow_time: Float[np.ndarray, " time"]
    value: Float[np.ndarray, " time"]
    sd: Float[np.ndarray, " time"]
    common: float
    factor: Float[np.ndarray, " time"] | float = 1.0

    @property
    def own_sd(self) -> Float[np.ndarray, " time"]:
        """Standard deviation that is independent from reading to reading."""
        shared = self.common * np.abs(1.0 + self.value)
        own = np.sqrt(np.maximum(self.sd**2 - shared**2, (0.1 * self.sd) ** 2))
        return self.factor * own


def past_of(states: States, known: NominalInUse | None, most: int = MOST) -> dict[str, Past]:
    """Take the changes of a twin of one mode that are estimated, from its valid states.

    Parameters
    ----------
    most
        Valid states that are used: the newest.
    """
    used = states[states["reasons"] == 0][-most:]
    if known is None or not len(used):
        return {}
    time, common = np.ascontiguousarray(used["slow_time"]), 2.0 * known.frequency_relative_sd
    past = {}
    for name in _estimated(used):
        value, sd, _, _ = np.ascontiguousarray(used[name].T)
        past[name] = Past(time, value, sd, common, sd_factor(covered_share(used)))
    return past


def past_of_elements(
    states: States, bodies: Bodies, memory: ElementMemory | None, most: int = MOST_OF_ELEMENTS
) -> dict[str, Past]:
    """Take the changes of each parameter of a twin of elements from its valid states.

    Parameters
    ----------
    most
        Valid states that are used: the newest.
    """
    if memory is None or not bodies:
        return {}
    rows = [row for row in np.flatnonzero(states["reasons"] == 0).tolist() if bodies[row]]
    rows = rows[-most:]
    told = [from_json(bodies[row] or b"")["elements"] for row in rows]
    time = np.ascontiguousarray(states["slow_time"][rows])
    factor = sd_factor(covered_share(states[rows]))
    past = {}
    for name in told[-1] if told else ():
        each = [one.get(name, _GAP) for one in told]
        value, sd = np.array([(one["value"], one["sd"]) for one in each]).T.copy()
        relative = float(np.nanmedian(sd / (1.0 + value)))
        past[name] = Past(time, value, sd, math.sqrt(memory.common_share) * relative, factor)
    return past


def learn(
    past: Mapping[str, Past],
    process: forecast.Choice = "evidence",
    suspected: Mapping[str, Sequence[float]] | None = None,
    known: KnownEvents | None = None,
) -> LearntLaws:
    """Learn processes from the past of each quantity; empty if there are too few readings.

    Parameters
    ----------
    suspected
        Slow times of each quantity after which it was seen to jump.
    known
        Repairs and inspections of each that were told.
    """
    jumps, told = suspected or {}, known or {}
    if not _is_enough(past):
        return {}
    found: LearntLaws = {}
    for name, one in past.items():
        readings, events = (one.slow_time, one.value, one.own_sd), tuple(told.get(name, ()))
        outlook = forecast.fit(
            *readings, process=process, suspected=jumps.get(name, ()), known=events
        )
        gaussian = GaussianLaw(outlook, known=events)
        # Who knows that it repeats itself knows that it follows no degradation law; and a law
        # needs some readings after a repair.
        alone = process == "repeating" or not _is_past(events, one.slow_time)
        laws = [gaussian] if alone else [*STANDARD, gaussian]
        found[name] = LearntLaw(
            outlook, degradation.learn(*readings, laws=laws, events=_events_of(events, one))
        )
    return found


def _is_past(events: Sequence[KnownEvent], time: Float[np.ndarray, " time"]) -> bool:
    """Whether enough readings have followed the last repair or replacement."""
    last = max((event.time for event in events if is_jump(event)), default=-np.inf)
    return int(np.count_nonzero(time > last)) >= FEWEST


def _events_of(events: Sequence[KnownEvent], past: Past) -> list[degradation.KnownChange]:
    """Repairs and replacements as degradation laws take them."""
    found = []
    for event in events:
        before = past.value[past.slow_time <= event.time]
        size = abs(float(before[-1])) if len(before) else 0.0
        if isinstance(event, Repair):
            sd = math.hypot(event.level_sd, event.share_sd * size)
            found.append(
                degradation.KnownChange(event.time, min(max(event.share, 0.0), 1.0), sd)
            )
        elif isinstance(event, Replacement):
            sd = event.level_sd if event.level is not None else max(size, event.level_sd)
            found.append(degradation.KnownChange(event.time, 1.0, sd))
    return found


def forecast_state_of(
    past: Mapping[str, Past], outlooks: LearntLaws, known: KnownEvents | None = None
) -> ForecastState | None:
    """Take in the past of each quantity; None where there is too little to go by.

    Parameters
    ----------
    past
        Of each, its history, oldest first; all at the same slow times.
    outlooks
        What `learn` has learnt, from this past or from an earlier one.
    known
        Repairs and inspections of each that were told; those after its last reading too.
    """
    told = known or {}
    if not _is_enough(past) or not set(past) <= set(outlooks):
        return None
    time = next(iter(past.values())).slow_time
    begun = {
        name: continuation.begin(
            outlooks[name].outlook,
            one.slow_time,
            one.value,
            one.own_sd,
            known=told.get(name, ()),
        )
        for name, one in past.items()
    }
    laws = {
        name: _followed(outlooks[name].laws, one, begun[name], told.get(name, ()))
        for name, one in past.items()
    }
    common = {name: one.common for name, one in past.items()}
    return ForecastState(begun, laws, common, float(time.min()), float(time.max()))


def _followed(
    laws: Mixture, past: Past, begun: Continuation, events: Sequence[KnownEvent]
) -> Mixture:
    """Continue the filter over the readings after those that were learnt from.

    After a repair that the laws have not learnt, the processes go on alone.
    """
    if any(event.time >= laws.now for event in events if is_jump(event)):
        alone = GaussianPosterior(begun, 0.0, 1.0)
        return Mixture({GAUSSIAN: alone}, {GAUSSIAN: 1.0}, begun.time, laws.bound)
    later = past.slow_time > laws.now
    return laws.follow(past.slow_time[later], past.value[later], past.own_sd[later])


def advance(prospect: ForecastState, past: Mapping[str, Past]) -> ForecastState:
    """Take in further readings, at a constant cost each.

    Raises
    ------
    ValueError
        Where one is earlier than the last: begin anew with `forecast_state_of`.
    """
    begun, laws, since = dict(prospect.begun), dict(prospect.laws), prospect.since
    for name, one in past.items():
        if name not in begun or not len(one.slow_time):
            continue
        known = one._replace(common=prospect.common[name])
        begun[name] = begun[name].follow(known.slow_time, known.value, known.own_sd)
        laws[name] = laws[name].follow(known.slow_time, known.value, known.own_sd)
        since = max(since, float(known.slow_time.max()))
    return dataclasses.replace(prospect, begun=begun, laws=laws, since=since)


def forecast_changes(
    past: Mapping[str, Past],
    outlooks: LearntLaws,
    horizon: float | None,
    count: int,
    thresholds: Sequence[Limit] = (),
) -> ChangeForecast | None:
    """Forecast each quantity; None where there is too little to go by.

    Parameters
    ----------
    past, outlooks
        As for `forecast_state_of`.
    horizon, count, thresholds
        As for `forecast_from_state`.
    """
    prospect = forecast_state_of(past, outlooks)
    return (
        None if prospect is None else forecast_from_state(prospect, horizon, count, thresholds)
    )


def forecast_from_state(
    prospect: ForecastState,
    horizon: float | None,
    count: int,
    thresholds: Sequence[Limit] = (),
    unit: str | None = None,
) -> ChangeForecast:
    """Forecast each quantity, at a cost that does not hang on the length of its past.

    Parameters
    ----------
    horizon
        How far ahead, in slow time; None for as long as the history that is used.
    count
        At how many future times.
    thresholds
        Of which it is asked when they are reached.
    unit
        Of slow time, for the words.
    """
    since, span = prospect.since, prospect.since - prospect.first
    end = since + (horizon or span)
    later = since + (end - since) * np.arange(1, count + 1) / count
    futures = {name: prospect.futures(name, end) for name in prospect.laws}
    bands = {name: _band(drawn, later) for name, drawn in futures.items()}
    until = min((_informed_until(prospect, name) for name in prospect.begun), default=end)
    reasons: tuple[str, ...] = ()
    if later[-1] > until:
        reasons = (
            f"Beyond {time_in_words(until, unit)} the readings contain little information: the "
            "forecast only extrapolates its trend. Ask for a shorter horizon, or wait "
            "for more readings.",
        )
    crossings = tuple(
        (limit, futures[limit.quantity].crossing(limit.at, toward=limit.toward))
        for limit in thresholds
        if limit.quantity in futures
    )
    used = {
        name: LearntLaw(begun.outlook, prospect.laws[name])
        for name, begun in prospect.begun.items()
    }
    warnings = {name: laws.warning for name, laws in prospect.laws.items()}
    misfits = tuple(f"{name}: {text}" for name, text in warnings.items() if text)
    return ChangeForecast(
        since, end, later, bands, float(until), used, reasons, crossings, misfits,
        prospect.widening,
    )  # fmt: skip


def _informed_until(prospect: ForecastState, name: str) -> float:
    """Slow time beyond which readings say little.

    Gaussian processes forget what they have seen after about one length scale. A law is
    trusted as far ahead as the past is long: docs/remaining_life.md tests it no further.
    """
    if prospect.laws[name].weights.get(GAUSSIAN, 0.0) > 0.5:
        return prospect.begun[name].horizon
    return 2.0 * prospect.since - prospect.first


def _band(
    drawn: SampledFutures, later: Float[np.ndarray, " later"]
) -> Float[np.ndarray, "later 4"]:
    """Median, sd and central interval of all futures, straight between their instants.

    The mean would follow the few that run away.
    """
    after = np.clip(np.searchsorted(drawn.later, later), 1, len(drawn.later) - 1)
    part = (later - drawn.later[after - 1]) / (drawn.later[after] - drawn.later[after - 1])
    paths = drawn.paths[:, after - 1] * (1.0 - part) + drawn.paths[:, after] * part
    lo, hi = np.quantile(paths, [0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)], axis=0)
    return np.column_stack((np.median(paths, axis=0), paths.std(axis=0), lo, hi))


def current_changes(prospect: ForecastState | None) -> dict[str, tuple[float, float]]:
    """Mean and sd of each change at its last reading, given all readings."""
    found: dict[str, tuple[float, float]] = {}
    for name, begun in ({} if prospect is None else prospect.begun).items():
        here = begun.predict(np.array([begun.time]), level=LEVEL)
        mean = float(here.mean[0])
        assert prospect is not None
        sd = math.hypot(float(here.sd[0]), prospect.common[name] * abs(1.0 + mean))
        found[name] = mean, sd
    return found


def _is_enough(past: Mapping[str, Past]) -> bool:
    time = next((one.slow_time for one in past.values()), np.zeros(0))
    return len(time) >= FEWEST and bool(np.ptp(time) > 0)


def _estimated(states: States) -> list[str]:
    notes = int(states["notes"][-1])
    bits = {"stiffness_change": ASSUMES_STIFFNESS, "mass_change": ASSUMES_MASS}
    return [name for name, bit in bits.items() if not notes & bit]

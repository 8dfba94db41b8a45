"""Computes a maintenance plan from the forecast of a twin and its owner's costs."""

import dataclasses
import datetime
from typing import Literal

import numpy as np
from jaxtyping import Float

from slowtime.decisions import (
    Access,
    Ensemble,
    EstimateError,
    Observation,
    Plan,
    Terms,
    from_paths,
    make_plan,
)
from slowtime.degradation import Mixture
from slowtime_schemas.slow_times import LAST_CLOCK_S
from twin_server.estimate.forecast.changes import Past
from twin_server.estimate.forecast.futures import POINTS, futures_of
from twin_server.registration.costs import SECONDS, CostTable, Deciding

MEMORY = 5.0
"""Readings over which the error of an estimate is forgotten: about as many as a forecast's
filter averages."""

LEAST_DAMAGE = 0.02
"""Damage, over that at failure, below which the past tells no rate of ageing [1]: futures after
a repair then go on as those before it."""

MORE = (1, 3, 10, 30)
"""Counts of further readings of the sensor that is there, whose worth is told."""


class NotPlannableError(ValueError):
    """A plan that cannot be made; the text gives the reason and says what to do."""


@dataclasses.dataclass(frozen=True, slots=True)
class PlanOrder:
    """Input of a plan of one twin.

    Parameters
    ----------
    laws
        Degradation laws of the quantity that fails, after its last reading.
    common
        Of the error that all readings share, over 1 + change [1].
    reading_sd
        Of one reading of the change [1].
    every
        Slow time between readings.
    pace
        Seconds of the calendar in one slow time; None where that is not known.
    age
        Slow time from the first reading that is used to the last.
    unit
        Of slow time, as messages name it; None where none was given.
    widening
        Factor of the spread of the futures [1].
    since_ns
        Sensor time of the last reading [ns]; None where the calendar is not known.
    name
        Of the structure, as registered.
    past
        Valid readings of the quantity that fails that are told with the plan; None for none.
    """

    costs: CostTable
    decision: Deciding
    laws: Mixture
    common: float
    reading_sd: float
    every: float
    pace: float | None
    age: float
    unit: str | None = None
    widening: float = 1.0
    since_ns: int | None = None
    name: str = ""
    past: Past | None = None


@dataclasses.dataclass(frozen=True, slots=True)
class Planned:
    """A plan, in the owner's unit of time, and how many slow times one of these is."""

    plan: Plan
    slow_per_unit: float


def slow_per_unit(costs: CostTable, pace: float | None) -> float:
    """Slow times in one unit of the owner's times.

    Parameters
    ----------
    costs
        Costs, with the unit of the owner's times.
    pace
        Seconds in one slow time; None if unknown.

    Raises
    ------
    NotPlannableError
        Where the pace is needed and not known.
    """
    if costs.time_unit == "slow_time":
        return 1.0
    if pace is None or not pace > 0:
        raise NotPlannableError(
            f"costs.time_unit is {costs.time_unit!r}, and the history does not yet show "
            "how slow time relates to calendar time. Wait for two readings at different "
            "times, or "
            "give costs.time_unit='slow_time'."
        )
    return SECONDS[costs.time_unit] / pace


def plan_of(order: PlanOrder) -> Planned:
    """Draw futures of the quantity that fails, and compare all that may be done."""
    unit = slow_per_unit(order.costs, order.pace)
    futures = damage_futures(order, unit)
    limit = abs(order.decision.failure.at)
    now = float(np.std(futures.damage[:, 0]))
    terms = Terms(
        restored=order.decision.restored,
        error=EstimateError(now, MEMORY * order.every / unit),
        window=order.decision.window or 0.0,
        inspection=_inspection(order.decision, limit),
        observations=_observations(order, limit, unit),
        access=access_of(order, unit),
        accepted=order.decision.accepted,
    )
    return Planned(make_plan(futures, order.costs.costs(), terms), unit)


def access_of(order: PlanOrder, unit: float) -> Access:
    """Convert lead time, months and windows to times from now, in the owner's unit.

    Parameters
    ----------
    order
        Input of the plan.
    unit
        Slow times in one unit of the owner's times.

    Returns
    -------
    Lead time, and windows up to a year after the horizon.

    Raises
    ------
    NotPlannableError
        Where months are asked for and the calendar is not known, or all windows have closed.
    """
    decision, access = order.decision, order.decision.access
    if access.windows:
        since = order.laws.now
        left = [((a - since) / unit, (b - since) / unit) for a, b in access.windows]
        windows = tuple((max(begin, 0.0), end) for begin, end in left if end >= 0.0)
        if not windows:
            raise NotPlannableError(
                f"The last window of decision.access closed at slow time "
                f"{access.windows[-1][1]:g}, before the last reading at {since:g}. Give later "
                "windows."
            )
        return Access(lead=decision.lead_time, windows=windows)
    if not access.months or len({*access.months}) == 12:
        return Access(lead=decision.lead_time)
    if order.pace is None or order.since_ns is None:
        raise NotPlannableError(
            f"decision.access.months = {list(access.months)} was given, and the history does "
            "not yet show how slow time relates to calendar time. Wait for two readings at "
            "different times, or give decision.access.windows in slow time."
        )
    seconds = order.pace * unit
    spans = _months_open({*access.months}, order.since_ns / 1e9, decision.horizon * seconds)
    return Access(
        lead=decision.lead_time,
        windows=tuple((begin / seconds, end / seconds) for begin, end in spans),
    )


def _months_open(
    months: set[int], since_s: float, horizon_s: float
) -> list[tuple[float, float]]:
    """Give spans of the months asked for, from now up to a year after the horizon [s]."""
    day = datetime.datetime.fromtimestamp(since_s, datetime.UTC).replace(
        day=1, hour=0, minute=0, second=0, microsecond=0
    )
    spans: list[tuple[float, float]] = []
    last = min(since_s + horizon_s + 366 * 86400.0, LAST_CLOCK_S - 32 * 86400.0)
    while day.timestamp() <= last:
        following = (day + datetime.timedelta(days=32)).replace(day=1)
        if day.month in months:
            # A month ends a second before the next, so that no date lies in the wrong one.
            begin = max(day.timestamp() - since_s, 0.0)
            end = following.timestamp() - 1.0 - since_s
            if spans and begin - spans[-1][1] < 2.0:
                spans[-1] = spans[-1][0], end
            else:
                spans.append((begin, end))
        day = following
    return spans


def damage_futures(order: PlanOrder, unit: float) -> Ensemble:
    """Draw futures of the damage: the change over its value at failure.

    Parameters
    ----------
    order
        Input of the plan.
    unit
        Slow times in one unit of the owner's times.

    Returns
    -------
    Paths of the damage [1] over times in the owner's unit.
    """
    failure, laws = order.decision.failure, order.laws
    horizon = laws.now + order.decision.horizon * unit
    drawn = futures_of(laws, order.common, horizon, order.widening)
    grid = np.linspace(0.0, order.decision.horizon, POINTS + 1)
    damage = drawn.paths / failure.at
    toward: Literal["above", "below"] = "above" if failure.below is None else "below"
    # A rough path may have failed between two times at which it has not.
    failed = (drawn.failure_time(failure.at, toward=toward) - laws.now) / unit
    age = order.age / unit
    renewed = None
    if age > 0.0 and float(damage[:, 0].mean()) > LEAST_DAMAGE:

        def renewed(start: float) -> Ensemble:
            return _renewed(grid, damage, age, start)

    return dataclasses.replace(from_paths(grid, damage, renewed=renewed), failure_time=failed)


def _renewed(
    grid: Float[np.ndarray, " time"],
    damage: Float[np.ndarray, "path time"],
    age: float,
    start: float,
) -> Ensemble:
    """Return futures of an asset that ages as this one has: its past, then its futures.

    Damage that grows faster with age begins slowly again after a repair. The past is a
    straight line from no damage to today's.
    """
    now = damage[:, :1]
    since = grid + age * min(start / float(now.mean()), 1.0)
    later = np.clip(since - age, 0.0, grid[-1])
    step = grid[1] - grid[0]
    place = np.minimum((later / step).astype(int), len(grid) - 2)
    part = later / step - place
    ahead = damage[:, place] * (1.0 - part) + damage[:, place + 1] * part
    whole = np.where(since < age, now * since / age, ahead)
    return from_paths(grid, whole - whole[:, :1] + start)


def _inspection(decision: Deciding, limit: float) -> Observation | None:
    given = decision.inspection
    if given is None:
        return None
    if given.sd is not None:
        return Observation(name=given.name, sd=given.sd / limit)
    assert given.detects_half is not None
    half = given.detects_half / limit
    return Observation(name=given.name, kind="detection", half=half, slope=given.detects_slope)


def _observations(order: PlanOrder, limit: float, unit: float) -> tuple[Observation, ...]:
    """Sensors that may be added, and more readings of the one that is there."""
    found = [
        Observation(
            name=one.name,
            kind="readings",
            sd=one.sd / limit,
            count=one.count,
            every=one.every,
            cost=one.cost,
        )
        for one in order.decision.sensors
    ]
    every = order.every / unit
    for count in MORE:
        if count * every <= order.decision.horizon / 2:
            name = "one more reading" if count == 1 else f"{count} more readings"
            sd = order.reading_sd / limit
            found.append(
                Observation(name=name, kind="readings", sd=sd, count=count, every=every)
            )
    return tuple(found)

"""Places reported events in a history, by the quantity that they change."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TypeAlias

import numpy as np
from jaxtyping import Float, Int

from slowtime.evolution.events.known_events import (
    NOMINAL_SD,
    UNKNOWN_SHARE,
    Detection,
    DetectionCurve,
    KnownEvent,
    Measurement,
    Repair,
    Replacement,
    is_jump,
)
from slowtime_schemas.asset_events import AssetEvent, is_mass
from twin_server.history.states import States

KnownEvents: TypeAlias = Mapping[str, Sequence[KnownEvent]]
"""Of each quantity, the events that were told of it."""


def known_of(
    events: Iterable[AssetEvent],
    t_ns: Int[np.ndarray, " time"],
    slow_time: Float[np.ndarray, " time"],
    names: Iterable[str],
) -> dict[str, tuple[KnownEvent, ...]]:
    """Place events in a history, by the quantity that they concern.

    Parameters
    ----------
    events
        Those that hold, in any order.
    t_ns, slow_time
        Of each reading.
    names
        Quantities of the twin.

    Returns
    -------
    Of each quantity that any event concerns, the events in the order of their time. An event
    stands after the last reading at or before it; one before the first reading is left out.
    """
    every = tuple(names)
    found: dict[str, list[KnownEvent]] = {}
    for event in events:
        at = place(event, t_ns, slow_time)
        if at is None:
            continue
        for name in every:
            if event.quantity in (None, name):
                made = _made(event, at, name, len(every))
                if made is not None:
                    found.setdefault(name, []).append(made)
    return {name: tuple(sorted(each, key=lambda one: one.time)) for name, each in found.items()}


def place(
    event: AssetEvent,
    t_ns: Int[np.ndarray, " time"],
    slow_time: Float[np.ndarray, " time"],
) -> float | None:
    """Slow time of the last reading at or before an event; None where there is none.

    Parameters
    ----------
    event
        Event with a slow time or a time [ns since 1970].
    t_ns
        Times of the readings [ns since 1970].
    slow_time
        Slow times of the readings.

    Returns
    -------
    The slow time, or None.
    """
    if event.slow_time is not None:
        before = slow_time <= event.slow_time
    else:
        before = t_ns <= (event.happened_ns or 0)
    return float(slow_time[before].max()) if before.any() else None


def come_after(states: States, events: Iterable[AssetEvent]) -> bool:
    """Whether readings come after all events, so that no event has to be placed again."""
    if not len(states):
        return True
    first_ns, first = int(states["t_ns"].min()), float(states["slow_time"].min())
    return all(
        (event.happened_ns or 0) < first_ns
        if event.slow_time is None
        else event.slow_time < first
        for event in events
    )


def jump_times(known: KnownEvents) -> dict[str, list[float]]:
    """Slow times after which a quantity was reported to have jumped."""
    return {
        name: [event.time for event in each if is_jump(event)] for name, each in known.items()
    }


def _made(event: AssetEvent, at: float, name: str, count: int) -> KnownEvent | None:
    if event.kind == "repair":
        result = event.repair
        if result is None or result.restored_share is None:
            share, sd = UNKNOWN_SHARE
        else:
            share, sd = result.restored_share, result.restored_share_sd
        return Repair(time=at, share=share, share_sd=sd)
    if event.kind == "replacement":
        part = event.replacement
        if part is None:
            return Replacement(time=at)
        return Replacement(time=at, level=part.change, level_sd=part.sd or NOMINAL_SD)
    if event.measured is not None and (event.quantity == name or count == 1):
        return Measurement(time=at, value=event.measured.value, sd=event.measured.sd)
    if event.detection is not None and not is_mass(name):
        law = event.detection.probability_of_detection
        curve = DetectionCurve(
            a50=law.a50,
            slope=law.slope,
            points=tuple((point.damage, point.probability) for point in law.points),
        )
        return Detection(time=at, detected=event.detection.detected, curve=curve)
    return None

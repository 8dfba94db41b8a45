"""The readings, sudden changes and known events that a forecast is learnt from."""

import dataclasses
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int

from slowtime.evolution.events.known_events import KnownEvent
from slowtime_schemas.asset_events import AssetEvent
from twin_server.estimate import Twin
from twin_server.estimate.forecast.changes import FEWEST
from twin_server.estimate.forecast.known_events import KnownEvents, jump_times
from twin_server.estimate.renewals import RENEWED
from twin_server.history.states import States
from twin_server.persist import StoredHistory
from twin_server.pipeline.ingestion.updates import TwinUpdate
from twin_server.pipeline.monitoring.model_changes import CHANGED
from twin_server.registration.twin import Registration

LOOK_BACK = 1_000
"""Newest states among which the valid ones are learnt from, and newest events that are read."""

_AFTER = (3, 8)
"""Readings after a change of the model at which a forecast learns anew."""

SHIFT = 40
"""Bits of the sequence in a key; the boot number is above them."""

_SEQUENCE = (1 << SHIFT) - 1

Key: TypeAlias = int
"""Place of a state in the order of a twin's history: boot number and sequence."""

SuddenChanges: TypeAlias = tuple[tuple[str, tuple[float, ...]], ...]
"""Of each quantity, slow times after which it was told to have gone elsewhere."""


class LearningInput(NamedTuple):
    """Input from which the laws of a forecast are learnt; equal inputs give equal laws.

    Attributes
    ----------
    mark
        Key of the last state that is learnt from.
    suspected
        Sudden changes that were detected within the states.
    known
        Events that people have told of, by quantity.
    """

    registration: Registration
    mark: Key
    suspected: SuddenChanges
    known: tuple[tuple[str, tuple[KnownEvent, ...]], ...] = ()


@dataclasses.dataclass(frozen=True, slots=True)
class NewestRows:
    """Keys, slow times and validity of the newest states of a twin."""

    keys: Int[np.ndarray, " row"]
    times: Float[np.ndarray, " row"]
    valid: Bool[np.ndarray, " row"]

    @classmethod
    def of(cls, numbers: Sequence[int], states: States) -> "NewestRows":
        """Take states, each with the number of its boot."""
        keys = np.array(numbers, dtype=np.int64) << SHIFT | states["sequence"].astype(np.int64)
        return cls(keys, np.array(states["slow_time"]), states["reasons"] == 0)

    def with_more(self, numbers: Sequence[int], states: States) -> "NewestRows":
        """Append states, and keep the newest `LOOK_BACK`."""
        more = NewestRows.of(numbers, states)
        return NewestRows(
            np.concatenate([self.keys, more.keys])[-LOOK_BACK:],
            np.concatenate([self.times, more.times])[-LOOK_BACK:],
            np.concatenate([self.valid, more.valid])[-LOOK_BACK:],
        )


def update_behind(news: TwinUpdate, last: Key) -> TwinUpdate:
    """Keep the states of an update that come after a place in the history, and its events."""
    keys = [
        number << SHIFT | sequence
        for (number, _, _), sequence in zip(
            news.runs, news.states["sequence"].tolist(), strict=True
        )
    ]
    rows = [row for row, key in enumerate(keys) if key > last]
    return news._replace(
        states=news.states[rows],
        runs=[news.runs[row] for row in rows],
        bodies=[news.bodies[row] for row in rows] if news.bodies else (),
    )


def happened_by(event: AssetEvent, t_ns: int, slow_time: float) -> bool:
    """Whether an event happened by a moment.

    Parameters
    ----------
    t_ns
        Sensor time of the moment [ns since 1970-01-01 UTC].
    slow_time
        Slow time of the moment, used where the event is told in slow time.
    """
    if event.slow_time is not None:
        return event.slow_time <= slow_time
    return (event.happened_ns or 0) <= t_ns


def learning_mark(
    rows: NewestRows, changes: Mapping[str, list[float]], known: KnownEvents, refresh: int
) -> int:
    """Return the row of the last reading to learn from: one whose number `refresh` divides.

    After a change of the model some readings are enough to learn anew. Where fewer than
    `FEWEST` valid readings come before the mark, all readings are learnt from.

    Parameters
    ----------
    changes
        Slow times after which each quantity was detected to have changed.
    known
        Events that people have told of, by quantity.
    refresh
        Readings after which laws are learnt anew.
    """
    count = len(rows.keys)
    marks = np.flatnonzero((rows.keys & _SEQUENCE) % refresh == 0)
    last = int(marks[-1]) if len(marks) else -1
    begun = rows.times.min()
    every = (*changes.values(), *jump_times(known).values())
    since = [at for each in every for at in each if at >= begun]
    followed = np.searchsorted(rows.times, since, side="right")[:, None] - 1 + np.array(_AFTER)
    last = int(np.max(followed[followed < count], initial=last))
    return last if np.count_nonzero(rows.valid[: last + 1]) >= FEWEST else count - 1


def learning_input_of(
    twin: Twin,
    rows: NewestRows,
    last: int,
    changes: Mapping[str, list[float]],
    known: KnownEvents,
) -> LearningInput:
    """Make the input of learning from the rows up to `last`.

    Parameters
    ----------
    last
        Row of the last reading to learn from, see `learning_mark`.
    changes
        Slow times after which each quantity was detected to have changed.
    known
        Events that people have told of, by quantity.
    """
    within = float(rows.times.min()), float(rows.times[last])
    suspected = _sudden_changes(changes, *within)
    told = {
        name: tuple(e for e in each if within[0] <= e.time < within[1])
        for name, each in known.items()
    }
    learnt_with = tuple((name, each) for name, each in sorted(told.items()) if each)
    return LearningInput(twin.registration, int(rows.keys[last]), suspected, learnt_with)


def _sudden_changes(
    changes: Mapping[str, list[float]], first: float, until: float
) -> SuddenChanges:
    told = {
        name: sorted({at for at in each if first <= at < until})
        for name, each in changes.items()
    }
    return tuple((name, tuple(each)) for name, each in sorted(told.items()) if each)


def changes_in(bodies: Iterable[str]) -> list[tuple[str, float]]:
    """Quantity and slow time of each change of the model among some events."""
    found = []
    for text in bodies:
        if CHANGED in text:
            body = json.loads(text)
            if body["kind"] == CHANGED:
                found.append((body["details"]["quantity"], body["details"]["since"]))
    return found


def renewals_in(bodies: Iterable[str]) -> list[float]:
    """Slow times of the first readings of renewed structures among some events."""
    found = []
    for text in bodies:
        if RENEWED in text:
            body = json.loads(text)
            if body["kind"] == RENEWED:
                found.append(body["slow_time"])
    return found


def since_last_renewal(found: StoredHistory, renewals: list[float]) -> StoredHistory:
    """Keep a history from the last reading that is the first of a renewed structure.

    Parameters
    ----------
    found
        History of a twin.
    renewals
        Slow times of the first readings after renewals.

    Returns
    -------
    The history from the last of these on.
    """
    firsts = np.flatnonzero(np.isin(found.states["slow_time"], renewals))
    if not firsts.size:
        return found
    kept = slice(int(firsts[-1]), None)
    return found._replace(
        states=found.states[kept], number=found.number[kept], bodies=found.bodies[kept]
    )

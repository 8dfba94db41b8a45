"""Keeps the outlooks that each twin has stated, and scores them as truth arrives.

An outlook is kept at readings that `is_due` names, from what the twin knew then. It follows
from the history, so that a replay states the same. The scores are as of the last kept outlook.
"""

import collections
import dataclasses
import json
import threading
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from pydantic_core import to_json

from twin_server.estimate import ForecastState, Past, Twin, past_of, past_of_elements
from twin_server.estimate.forecast.statements import (
    KEPT,
    LONGEST,
    Verification,
    is_due,
    state_outlook,
    truth_of,
    verify,
)
from twin_server.history.states import States
from twin_server.persist import OutlookRow, Store, StoredHistory

from .learning_input import LOOK_BACK, SHIFT, Key

LOOK_FAR_BACK = KEPT * LONGEST + LOOK_BACK
"""Newest states: the truth of kept outlooks, and what the oldest was made of."""

MOST_KEPT = 500
"""Twins whose scores are kept in memory, those asked for last: some 100 kB each."""


class Scored(NamedTuple):
    """Kept outlooks of a twin, and their scores as of the last of them."""

    key: Key
    statements: tuple[Mapping[str, Any], ...]
    scores: Verification

    @property
    def since(self) -> float:
        """Slow time of the last kept outlook, up to which the truth counts."""
        return float(self.statements[-1]["since"])

    @property
    def widening(self) -> Mapping[str, Any]:
        """Of each quantity the factor in force, with its probability and effective number."""
        widening: Mapping[str, Any] = self.statements[-1]["widening"]
        return widening


class PastOutlooks:
    """Outlooks that twins have stated, in the store; and what came of them."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._verified: collections.OrderedDict[str, Scored] = collections.OrderedDict()
        self._lock = threading.Lock()

    def forget(self, twin_id: str) -> None:
        """Note that a twin's history has been rewritten or deleted."""
        with self._lock:
            self._verified.pop(twin_id, None)

    def factors(self, twin_id: str, until: Key | None = None) -> dict[str, float]:
        """Factors by which the futures of a twin are told wider, as of a reading."""
        rows = self._store.outlooks(twin_id, until, 1)
        if not rows:
            return {}
        widening = json.loads(rows[0].body)["widening"]
        return {name: one["factor"] for name, one in widening.items()}

    def due(self, twin_id: str, found: StoredHistory, stated: Key | None) -> list[int]:
        """Rows of a history after which an outlook has to be kept, and is not yet.

        Parameters
        ----------
        found
            The history, `LOOK_FAR_BACK`.
        stated
            Key up to which all that could be stated is kept; None where that is not known.
        """
        rows = self._store.outlooks(twin_id, None, 1)
        last = max(rows[0].id if rows else -1, -1 if stated is None else stated)
        return [row for row, key in enumerate(keys_of(found)) if key > last and due_at(key)][
            -KEPT:
        ]

    def keep(
        self,
        twin_id: str,
        twin: Twin,
        found: StoredHistory,
        state: ForecastState,
        interrupted: Sequence[float],
    ) -> None:
        """State the outlook of a twin after the last row of a history, and keep it.

        Its spread follows from what came by then of the outlooks before it.

        Parameters
        ----------
        found
            The history up to the reading, as far back as the first kept outlook.
        state
            What is believed after the reading.
        interrupted
            Slow times of renewals and repairs that were known by then.
        """
        rows = self._store.outlooks(twin_id, None, KEPT - 1)
        before = [json.loads(row.body) for row in rows]
        scores = _scored(before, twin, found, interrupted)
        factors = {name: one.widening.factor for name, one in scores.quantities.items()}
        stated = state_outlook(
            dataclasses.replace(state, widening=factors),
            twin.registration.outlook_horizon,
            twin.registration.thresholds(),
        )
        stated["widening"] = {
            name: dataclasses.asdict(one.widening) for name, one in scores.quantities.items()
        }
        key = keys_of(found)[-1]
        body = to_json(stated).decode()
        self._store.add_outlook(OutlookRow(twin_id, key, state.since, body), KEPT)
        self._remember(twin_id, Scored(key, (*before, stated), scores))

    def known(self, twin_id: str) -> Scored | None:
        """Give the scores of a twin where they are of its last kept outlook; else None."""
        rows = self._store.outlooks(twin_id, None, 1)
        with self._lock:
            known = self._verified.get(twin_id)
        return known if rows and known is not None and known.key == rows[-1].id else None

    def verify(
        self, twin_id: str, twin: Twin, found: StoredHistory, interrupted: Sequence[float]
    ) -> Scored | None:
        """Score the kept outlooks of a twin; None where there are none.

        Parameters
        ----------
        found
            Its history, `LOOK_FAR_BACK`.
        interrupted
            Slow times of renewals and repairs.
        """
        rows = self._store.outlooks(twin_id)
        if not rows:
            return None
        statements = tuple(json.loads(row.body) for row in rows)
        here = cut(found, sum(key <= rows[-1].id for key in keys_of(found)))
        scores = _scored(statements[:-1], twin, here, interrupted)
        told = Scored(rows[-1].id, statements, scores)
        self._remember(twin_id, told)
        return told

    def _remember(self, twin_id: str, told: Scored) -> None:
        with self._lock:
            self._verified[twin_id] = told
            self._verified.move_to_end(twin_id)
            while len(self._verified) > MOST_KEPT:
                self._verified.popitem(last=False)


def keys_of(found: StoredHistory) -> list[Key]:
    """Keys of the rows of a history."""
    return [
        number << SHIFT | sequence
        for number, sequence in zip(
            found.number, found.states["sequence"].tolist(), strict=True
        )
    ]


def due_at(key: Key) -> bool:
    """Whether an outlook is kept after the reading of a key."""
    return is_due(key & ((1 << SHIFT) - 1))


def cut(found: StoredHistory, count: int, most: int | None = None) -> StoredHistory:
    """Keep the first so many rows of a history; of these at most the last `most`."""
    part = slice(0 if most is None else max(count - most, 0), count)
    return found._replace(
        states=found.states[part], number=found.number[part], bodies=found.bodies[part]
    )


def past_states(twin: Twin, states: States, bodies: Any, **most: int) -> dict[str, Past]:
    """Take the changes of a twin that are estimated, from its valid states."""
    elements = twin.checkpoint.elements
    if elements is None:
        return past_of(states, twin.checkpoint.known, **most)
    return past_of_elements(states, bodies, elements, **most)


def _scored(
    statements: Sequence[Mapping[str, Any]],
    twin: Twin,
    found: StoredHistory,
    interrupted: Sequence[float],
) -> Verification:
    past = past_states(twin, found.states, found.bodies, most=LOOK_FAR_BACK)
    if statements:
        # What came before the first of them is not needed.
        first = statements[0]["since"]
        past = {
            name: Past(*(_from(one.slow_time >= first, part) for part in one))
            for name, one in past.items()
        }
    return verify(statements, truth_of(past), interrupted)


def _from(used: Any, part: Any) -> Any:
    return part if isinstance(part, float) else part[used]

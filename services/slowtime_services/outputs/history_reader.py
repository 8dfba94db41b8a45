"""Reads from a twin server what follows the position of an output."""

import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from slowtime_schemas.answers.history import EventModel
from slowtime_schemas.answers.twins import RegisteredTwin, State
from slowtime_services.client import AnswerError, Client

from .batch import Batch
from .positions import Position, Positions

PAGE = 500
"""States or events of one batch; a line each, databases recommend some thousand lines."""

EVENTS_S = 10.0
"""How often events of a twin are asked for whose state has not changed [s]."""

REESTIMATED = frozenset({"registered", "estimated_anew"})
"""Kinds of events after which the states of a history are others."""


class Found(NamedTuple):
    """A batch, and the position that an output has once it is sent."""

    batch: Batch
    position: Position


class HistoryReader:
    """Reads the histories of twins for one output, in pages.

    Parameters
    ----------
    from_beginning
        Whether a twin that is new to the output is sent from its first state on, and not from
        its latest.
    is_archive
        Whether all states are sent again after the history was estimated anew.
    """

    def __init__(
        self,
        client: Client,
        positions: Positions,
        takes: Callable[[str], bool],
        *,
        from_beginning: bool,
        is_archive: bool,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._client, self._positions, self._takes = client, positions, takes
        self._from_beginning, self._is_archive = from_beginning, is_archive
        self._now_s = now_s
        self._seen: dict[str, tuple[RegisteredTwin, float]] = {}

    def read(self) -> Iterator[Found]:
        """Yield what is new of all twins; the receiver acknowledges each before the next."""
        for twin in self._client.twins():
            if self._takes(twin.id) and self._may_have_news(twin):
                began_s = self._now_s()
                yield from self._of_twin(twin)
                self._seen[twin.id] = (twin, began_s)

    def forget(self) -> None:
        """Tell the present status of each twin again, as to a receiver that has restarted."""
        self._seen.clear()

    def _may_have_news(self, twin: RegisteredTwin) -> bool:
        before = self._seen.get(twin.id)
        return before is None or twin != before[0] or self._now_s() - before[1] > EVENTS_S

    def _of_twin(self, twin: RegisteredTwin) -> Iterator[Found]:
        position = self._positions.of(twin.id)
        is_told = self._seen.get(twin.id, (None,))[0] == twin
        if position is None and not self._from_beginning:
            yield (latest := self._latest(twin))
            position, is_told = latest.position, True
        position = position or Position()
        while True:
            events = self._client.events(twin.id, after=position.event, limit=PAGE)
            if self._is_archive and any(one.kind in REESTIMATED for one in events):
                position = position._replace(state=":0")
            states = self._states(twin.id, position)
            # A page that is not full is the last: what comes meanwhile is found next time.
            is_latest = len(states) < PAGE
            if states or events or not is_told:
                position = _after(position, states, events)
                batch = Batch(twin, tuple(states), tuple(events), is_latest)
                yield Found(batch, position)
                is_told = True
            if is_latest and len(events) < PAGE:
                return

    def _states(self, twin_id: str, position: Position) -> list[State]:
        try:
            return self._client.history_after(twin_id, position.state, limit=PAGE)
        except AnswerError as error:
            if error.kind != "no-such-boot":
                raise
            # Another database, such as one that was begun anew.
            return self._client.history_after(twin_id, limit=PAGE)

    def _latest(self, twin: RegisteredTwin) -> Found:
        """Return the latest state alone, and the position behind it."""
        newest = self._client.events(twin.id, limit=1)
        states = self._client.history(twin.id, start=str(twin.t_ns or 0), max_points=2)[-1:]
        position = _after(Position(), states, newest)
        return Found(Batch(twin, tuple(states), ()), position)


def _after(
    position: Position, states: Sequence[State], events: Sequence[EventModel]
) -> Position:
    state = f"{states[-1].boot}:{states[-1].sequence}" if states else position.state
    return Position(state, events[-1].number if events else position.event)

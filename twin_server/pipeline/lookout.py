"""Looks out for jumps in what twins estimate, beside the work, and says so by an event.

What it holds follows from the history: a server that starts again reads the newest part of it.
"""

import json
import logging
import queue
import threading
from collections.abc import Mapping

from twin_server.estimate import Noticed, Past, Series, past_of, past_of_elements
from twin_server.estimate.lookout import MOST
from twin_server.persist import Store

from .core import Pipeline
from .news import News

logger = logging.getLogger(__name__)

CHANGED = "model_changed"
LATE = 8
"""Readings back to which a change is told that is found only as the past is read again."""

_WAITING = 100_000
_PAUSE_S = 0.5


class Lookout:
    """A thread that hears what is new of each twin.

    Parameters
    ----------
    pipeline
        Whose twins are watched; it also keeps the events.
    """

    def __init__(self, pipeline: Pipeline, store: Store) -> None:
        self._pipeline, self._store = pipeline, store
        self._news: queue.Queue[tuple[str, News | None]] = queue.Queue(_WAITING)
        self._minds: dict[str, dict[str, Series]] = {}
        self._missed: set[str] = set()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="lookout", daemon=True)

    def start(self) -> None:
        """Begin to look out."""
        self._thread.start()

    def stop(self) -> None:
        """Look out no more."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    def tell(self, news: News) -> None:
        """Hear what is new of one twin."""
        if len(news.states):
            self._put(news.twin_id, news)

    def reset(self, twin_id: str) -> None:
        """Hear that a twin's history has been made anew, or has gone."""
        self._put(twin_id, None)

    def _put(self, twin_id: str, news: News | None) -> None:
        try:
            self._news.put_nowait((twin_id, news))
        except queue.Full:
            # It is read from the history again when there is time.
            self._missed.add(twin_id)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                twin_id, news = self._news.get(timeout=_PAUSE_S)
            except queue.Empty:
                continue
            try:
                self._hear(twin_id, news)
            except Exception:
                if not self._stop.is_set():
                    self._minds.pop(twin_id, None)
                    logger.exception("%s could not be watched; going on.", twin_id)

    def _hear(self, twin_id: str, news: News | None) -> None:
        if news is None or twin_id in self._missed:
            self._missed.discard(twin_id)
            self._minds.pop(twin_id, None)
        twin = self._pipeline.twin(twin_id)
        if twin is None or news is None:
            return
        wanted = twin.registration.forecast
        odds = wanted.readings_between_false_alarms
        if odds is None or wanted.process == "repeating":
            self._minds.pop(twin_id, None)
            return
        if twin_id not in self._minds:
            self._minds[twin_id] = {}
            self._look_back(twin_id, odds)
            return
        elements = twin.checkpoint.elements
        past = (
            past_of(news.states, twin.checkpoint.known)
            if elements is None
            else past_of_elements(news.states, news.bodies, elements)
        )
        for name, found, _ in self._taken(twin_id, past, odds):
            self._say(twin_id, name, found)

    def _look_back(self, twin_id: str, odds: float) -> None:
        """Read the newest part of the history; tell what nobody was told yet."""
        twin = self._pipeline.twin(twin_id)
        assert twin is not None
        found = self._store.history(twin_id, limit=2 * MOST, newest=True)
        elements = twin.checkpoint.elements
        past = (
            past_of(found.states, twin.checkpoint.known)
            if elements is None
            else past_of_elements(found.states, found.bodies, elements)
        )
        told = self._told(twin_id)
        for name, noticed, left in self._taken(twin_id, past, odds):
            if left < LATE and (name, noticed.since) not in told:
                self._say(twin_id, name, noticed)

    def _taken(
        self, twin_id: str, past: Mapping[str, Past], odds: float
    ) -> list[tuple[str, Noticed, int]]:
        """Take in readings; what was noticed, and how many readings follow it."""
        mind, found = self._minds[twin_id], []
        for name, one in past.items():
            series = mind.setdefault(name, Series(odds))
            readings = zip(
                one.slow_time.tolist(), one.value.tolist(), one.own_sd.tolist(), strict=True
            )
            for number, (time, value, sd) in enumerate(readings):
                if value != value or sd != sd:
                    continue
                if (noticed := series.take(time, value, sd)) is not None:
                    found.append((name, noticed, len(one.value) - 1 - number))
        return found

    def _told(self, twin_id: str) -> set[tuple[str, float]]:
        rows = self._store.events(twin_id, limit=10_000, newest=True)
        bodies = [json.loads(row.body) for row in rows]
        return {
            (body["details"]["quantity"], body["details"]["since"])
            for body in bodies
            if body["kind"] == CHANGED
        }

    def _say(self, twin_id: str, name: str, found: Noticed) -> None:
        said = f"{100 * found.size:+.3g} % ± {100 * found.sd:.2g} %"
        self._pipeline.note(
            twin_id,
            CHANGED,
            "warning",
            f"The model has changed: {name} went elsewhere after slow time {found.since:.6g}, "
            f"by {said.replace('-', '−')}. The forecast goes on from there.",
            {
                "quantity": name,
                "since": found.since,
                "size": found.size,
                "sd": found.sd,
                "odds": found.odds,
            },
        )

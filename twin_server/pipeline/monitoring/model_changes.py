"""Detects sudden changes in the estimates of all twins, and reports each by an event.

What it holds follows from the history: a server that starts again reads the newest part of it.
To look costs more than to estimate. It takes half of the time at most, none while features
wait; a fleet too large for that is looked at one twin after the other, at what came since.
"""

import json
import logging
import threading
import time
from collections.abc import Iterable, Mapping, Sequence

from slowtime_schemas.asset_events import AssetEvent, is_mass
from slowtime_schemas.slow_times import time_in_words
from twin_server.estimate import DetectedChange, Detector, Past, past_of, past_of_elements
from twin_server.estimate.change_detection import MOST
from twin_server.estimate.forecast.known_events import come_after, jump_times, known_of
from twin_server.estimate.renewals import RENEWED
from twin_server.events.asset_events import QUESTION, TOLD, effective
from twin_server.persist import Store
from twin_server.pipeline.ingestion.pipeline import Pipeline
from twin_server.pipeline.ingestion.updates import TwinUpdate

logger = logging.getLogger(__name__)

CHANGED = "model_changed"
LATE = 8
"""Readings back to which a change is told that is found only as the past is read again."""

WAITING = 20_000
"""States that wait to be looked at; where there are more, they are read from the history."""
MOST_WATCHED = 2000
"""Twins of which is kept what to expect, those looked at last; of others it is learnt anew."""
BUSY = 200
"""Messages that wait to be taken in, from which nothing else is done."""

_PAUSE_S = 0.5
"""Interval at which the thread looks for work [s]."""


def was_told(
    told: Iterable[tuple[str, float]], quantity: str, found: DetectedChange, at: float
) -> bool:
    """Whether a reported change is the one noticed at a slow time.

    Read again with another past, the same change may begin some readings sooner or later; none
    begins anew before the last was noticed.

    Parameters
    ----------
    told
        Quantity and slow time of each reported change.
    quantity
        Quantity of the change found.
    found
        The change found.
    at
        Slow time at which it was found.
    """
    apart = at - found.since
    return any(name == quantity and abs(since - found.since) < apart for name, since in told)


def _renewals(bodies: Iterable[str]) -> list[float]:
    """Slow times of the first readings of renewed structures."""
    events = [json.loads(body) for body in bodies]
    return [event["slow_time"] for event in events if event["kind"] == RENEWED]


class ModelChangeMonitor:
    """Thread that detects sudden changes in the updates of each twin.

    Parameters
    ----------
    pipeline
        Whose twins are watched; it also keeps the events.
    """

    def __init__(self, pipeline: Pipeline, store: Store) -> None:
        self._pipeline, self._store = pipeline, store
        self._news: dict[str, list[TwinUpdate]] = {}
        self._states = 0
        self._missed: set[str] = set()
        self._gone: set[str] = set()
        self._changed = threading.Condition()
        self._detectors: dict[str, dict[str, Detector]] = {}
        self._seen: dict[str, float] = {}
        self._events: dict[str, list[AssetEvent]] = {}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="model-changes", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Stop the thread."""
        self._stop.set()
        with self._changed:
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join()

    def tell(self, news: TwinUpdate) -> None:
        """Queue the update of one twin."""
        if not len(news.states) and not any(TOLD in body for _, body in news.events):
            return
        with self._changed:
            self._news.setdefault(news.twin_id, []).append(news)
            self._states += len(news.states)
            if self._states > WAITING:
                # The history has it too.
                self._missed.update(self._news)
                self._news = {twin_id: [] for twin_id in self._news}
                self._states = 0
            self._changed.notify_all()

    def reset(self, twin_id: str) -> None:
        """Note that a twin's history has been rewritten or deleted."""
        with self._changed:
            self._states -= sum(len(news.states) for news in self._news.get(twin_id, ()))
            self._news[twin_id] = []
            self._gone.add(twin_id)
            self._changed.notify_all()

    def _next(self) -> tuple[str, Sequence[TwinUpdate], bool] | None:
        """Wait for news; give the twin that waits longest, and whether some were let go."""
        with self._changed:
            if not self._news:
                self._changed.wait(_PAUSE_S)
            if not self._news:
                return None
            twin_id = next(iter(self._news))
            news = self._news.pop(twin_id)
            self._states -= sum(len(one.states) for one in news)
            missed, gone = twin_id in self._missed, twin_id in self._gone
            self._missed.discard(twin_id)
            self._gone.discard(twin_id)
        if gone:
            self._detectors.pop(twin_id, None)
            self._seen.pop(twin_id, None)
            self._events.pop(twin_id, None)
        return twin_id, news, missed and not gone

    def _run(self) -> None:
        while not self._stop.is_set():
            turn = self._next()
            if turn is None:
                continue
            began_s = time.thread_time()
            try:
                self._hear(*turn)
            except Exception:
                if not self._stop.is_set():
                    self._detectors.pop(turn[0], None)
                    logger.exception("Change detection of %s failed; continuing.", turn[0])
            self._stop.wait(time.thread_time() - began_s)
            while self._pipeline.waiting > BUSY and not self._stop.wait(_PAUSE_S):
                pass

    def _hear(self, twin_id: str, every: Sequence[TwinUpdate], missed: bool) -> None:
        twin = self._pipeline.twin(twin_id)
        if twin is None or not (every or missed):
            return
        wanted = twin.registration.forecast
        odds = wanted.readings_between_false_alarms
        if odds is None or wanted.process == "repeating":
            self._detectors.pop(twin_id, None)
            return
        known = self._detectors.pop(twin_id, None)
        if any(TOLD in body for news in every for _, body in news.events) or not all(
            come_after(news.states, self._events.get(twin_id, ())) for news in every
        ):
            # An event was told, or stands elsewhere among the readings now: all is read again.
            missed = True
        # Behind all others: those first that have not been looked at for longest.
        self._detectors[twin_id] = {} if known is None else known
        while len(self._detectors) > MOST_WATCHED:
            self._detectors.pop(next(iter(self._detectors)))
        if known is None or missed:
            self._look_back(twin_id, odds)
            return
        elements = twin.checkpoint.elements
        for news in every:
            past = (
                past_of(news.states, twin.checkpoint.known)
                if elements is None
                else past_of_elements(news.states, news.bodies, elements)
            )
            renewed = _renewals(body for _, body in news.events)
            for name, found, at, _ in self._detect_changes(twin_id, past, odds, renewed):
                self._say(twin_id, name, found, at)

    def _look_back(self, twin_id: str, odds: float) -> None:
        """Read the newest part of the history; report changes that were not reported yet.

        Of what was looked at before, or by a server before this one, only the newest.
        """
        seen = self._seen.get(twin_id, float("inf"))
        twin = self._pipeline.twin(twin_id)
        assert twin is not None
        found = self._store.history(twin_id, limit=2 * MOST, newest=True)
        elements = twin.checkpoint.elements
        past = (
            past_of(found.states, twin.checkpoint.known)
            if elements is None
            else past_of_elements(found.states, found.bodies, elements)
        )
        rows = self._store.events(twin_id, limit=10_000, newest=True)
        events = effective(row.message for row in self._store.asset_events(twin_id))
        self._events[twin_id] = events
        states = found.states
        known = known_of(events, states["t_ns"], states["slow_time"], past)
        self._detectors[twin_id] = {
            name: Detector(odds, tuple(times)) for name, times in jump_times(known).items()
        }
        every = self._detect_changes(twin_id, past, odds, _renewals(row.body for row in rows))
        told = self._reported_changes(twin_id) if every else set()
        for name, noticed, at, left in every:
            if (left < LATE or at > seen) and not was_told(told, name, noticed, at):
                self._say(twin_id, name, noticed, at)

    def _detect_changes(
        self,
        twin_id: str,
        past: Mapping[str, Past],
        odds: float,
        renewed: Sequence[float] = (),
    ) -> list[tuple[str, DetectedChange, float, int]]:
        """Take in readings; return detected changes, their time, and the readings after each.

        A series begins anew at each of the slow times `renewed`: that jump was announced.
        """
        mind, found = self._detectors[twin_id], []
        for name, one in past.items():
            series = mind.setdefault(name, Detector(odds))
            readings = zip(
                one.slow_time.tolist(), one.value.tolist(), one.own_sd.tolist(), strict=True
            )
            for number, (at, value, sd) in enumerate(readings):
                if value != value or sd != sd:
                    continue
                self._seen[twin_id] = at
                if series.past and any(series.past[-1][0] < one <= at for one in renewed):
                    series = mind[name] = Detector(odds, series.told)
                if (noticed := series.take(at, value, sd)) is not None:
                    found.append((name, noticed, at, len(one.value) - 1 - number))
        return found

    def _reported_changes(self, twin_id: str) -> set[tuple[str, float]]:
        rows = self._store.events(twin_id, limit=10_000, newest=True)
        bodies = [json.loads(row.body) for row in rows]
        return {
            (body["details"]["quantity"], body["details"]["since"])
            for body in bodies
            if body["kind"] == CHANGED
        }

    def _unit(self, twin_id: str) -> str | None:
        """Return the unit of slow time of a twin's newest reading."""
        newest = self._store.history(twin_id, limit=1, newest=True)
        return newest.boots[int(newest.number[-1])][1] if len(newest.number) else None

    def _say(self, twin_id: str, name: str, found: DetectedChange, at: float) -> None:
        since = time_in_words(found.since, self._unit(twin_id))
        moved = "rose" if found.size > 0 else "fell"
        said = f"{100 * abs(found.size):.3g} % ± {100 * found.sd:.2g} %"
        self._pipeline.note(
            twin_id,
            CHANGED,
            "warning",
            f"Sudden change: {name} {moved} by {said} after {since}. The "
            "forecast continues from there.",
            {
                "quantity": name,
                "since": found.since,
                "size": found.size,
                "sd": found.sd,
                "odds": found.odds,
            },
        )
        if restores(name, found):
            self._ask(twin_id, name, found, at)

    def _ask(self, twin_id: str, name: str, found: DetectedChange, at: float) -> None:
        """Ask whether a change toward the nominal model was an unreported repair."""
        since = time_in_words(found.since, self._unit(twin_id))
        self._pipeline.note(
            twin_id,
            QUESTION,
            "warning",
            f"Was something repaired? {name} went from {100 * found.before:+.3g} % to "
            f"{100 * (found.before + found.size):+.3g} % after {since}, "
            "and no repair was recorded. Record the repair, or say that it is a real change.",
            {
                "quantity": name,
                "since": found.since,
                "earliest": found.earliest,
                "noticed": at,
                "before": found.before,
                "size": found.size,
                "sd": found.sd,
            },
        )


def restores(name: str, found: DetectedChange) -> bool:
    """Whether a change brings a quantity back, as a repair does.

    A stiffness that rises was repaired or strengthened; of a mass, only what brings it nearer
    to the nominal model.
    """
    if not is_mass(name):
        return found.size > 0.0
    return abs(found.before + found.size) < abs(found.before)

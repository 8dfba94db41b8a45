"""Keeps the forecast state of each twin up to date as readings arrive.

Laws are learnt from the newest valid readings up to a mark, which takes long but is bounded.
Between marks each reading is one filter step. Requests are answered from the kept state; a
thread learns anew in the background, and only the first request for a twin waits. Everything
follows from the history, so that a restarted server gives the same forecasts.
"""

import collections
import dataclasses
import logging
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from slowtime.degradation import RemainingLife
from slowtime_schemas.asset_events import AssetEvent
from twin_server.estimate import (
    ChangeForecast,
    ForecastState,
    LearntLaws,
    Past,
    Twin,
    advance,
    forecast_from_state,
    forecast_state_of,
    learn,
)
from twin_server.estimate.forecast.known_events import (
    KnownEvents,
    come_after,
    jump_times,
    known_of,
)
from twin_server.events.asset_events import TOLD, effective
from twin_server.fairness import ALONE, Holder, acting_for, current_holder
from twin_server.persist import Store, StoredHistory
from twin_server.pipeline.analysis.learning_input import (
    LOOK_BACK,
    SHIFT,
    Key,
    LearningInput,
    NewestRows,
    changes_in,
    happened_by,
    learning_input_of,
    learning_mark,
    renewals_in,
    since_last_renewal,
    update_behind,
)
from twin_server.pipeline.analysis.past_outlooks import (
    LOOK_FAR_BACK,
    PastOutlooks,
    Scored,
    cut,
    due_at,
    keys_of,
    past_states,
)
from twin_server.pipeline.ingestion.pipeline import Pipeline
from twin_server.pipeline.ingestion.updates import TwinUpdate
from twin_server.pipeline.monitoring.model_changes import BUSY
from twin_server.registration.thresholds import Limit

logger = logging.getLogger(__name__)


MOST_KEPT = 500
"""Twins whose forecast states are kept, those asked for last: up to 0.2 MB a quantity."""

MOST_WAITING = 256
"""States of a twin that wait to be taken in by who asks next; more are taken in before."""

TOLD_STATES = 2
"""Latest states of a twin that a forecast was told of: risk and plan are told of the same."""

ANSWERS = 16
"""Forecasts that are kept of a twin until its next reading."""


A_TURN = 4
"""Past outlooks of one twin that are stated before other twins have their turn."""

_PAUSE_S = 0.5
"""Interval at which the background thread looks for work [s]."""


Run: TypeAlias = Callable[..., Any]
"""Calls a function with arguments that can be pickled, here or in a process of its own."""


@dataclasses.dataclass(slots=True)
class _CachedForecast:
    """Cached state of one twin; changed by the holder of its lock."""

    lock: threading.Lock = dataclasses.field(default_factory=threading.Lock)
    learning: threading.Lock = dataclasses.field(default_factory=threading.Lock)
    learnt_from: LearningInput | None = None
    laws: LearntLaws = dataclasses.field(default_factory=dict)
    prospect: ForecastState | None = None
    rows: NewestRows | None = None
    unit: str | None = None
    last: Key = -1
    waiting: list[TwinUpdate] = dataclasses.field(default_factory=list)
    count: int = 0
    changes: dict[str, list[float]] = dataclasses.field(default_factory=dict)
    told: "_ToldEvents" = dataclasses.field(default_factory=lambda: _ToldEvents((), {}))
    answers: dict[Any, ChangeForecast] = dataclasses.field(default_factory=dict)
    told_states: dict[float, ForecastState] = dataclasses.field(default_factory=dict)
    crossings: tuple[tuple[Limit, RemainingLife], ...] = ()
    since_told: int = 0
    stated: Key | None = None
    sound: bool = False
    asked: bool = False
    holder: Holder = ALONE


class _ToldEvents(NamedTuple):
    """Reported events of a twin, and their effect on each of its quantities."""

    events: Sequence[AssetEvent]
    known: KnownEvents


class CachedForecast(NamedTuple):
    """A forecast, and the unit of its slow time."""

    foresight: ChangeForecast
    unit: str | None


class _PastState(NamedTuple):
    """What was believed after the last row of a history, and what had interrupted it."""

    state: ForecastState
    interrupted: list[float]


class ForecastCache:
    """Forecast states of the twins that are asked for, advanced by the updates of each.

    Parameters
    ----------
    refresh
        Readings after which it is learnt anew.
    run
        Where is learnt; by default in the thread that asks.
    on_renewed
        Called in the background with each twin whose future is watched, as it is told anew, and
        the slow time of the reading that it is told of.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        store: Store,
        *,
        refresh: int = 25,
        run: Run = lambda function, *arguments: function(*arguments),
        on_renewed: Callable[[str, float | None], object] = lambda *_: None,
    ) -> None:
        self._pipeline, self._store = pipeline, store
        self._refresh, self._run, self._on_renewed = refresh, run, on_renewed
        self._kept: collections.OrderedDict[str, _CachedForecast] = collections.OrderedDict()
        self._lock = threading.Lock()
        self._past = PastOutlooks(store)
        self._of_the_past: dict[str, tuple[LearningInput, LearntLaws]] = {}
        self._due: dict[str, None] = {}
        self._changed = threading.Condition()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Start learning in the background."""
        self._thread = threading.Thread(target=self._work, name="forecasts", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Learn no more."""
        self._stop.set()
        with self._changed:
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    @property
    def due(self) -> int:
        """Number of twins that wait to be learnt, including those in progress."""
        return len(self._due)

    def tell(self, news: TwinUpdate) -> None:
        """Queue the update of one twin, in constant time."""
        kept, watched = self._kept.get(news.twin_id), self._is_watched(news.twin_id)
        if kept is None:
            if not watched or self._thread is None or len(self._kept) >= MOST_KEPT:
                return
            kept = self._known(news.twin_id)
        with kept.lock:
            kept.waiting.append(news)
            kept.count += len(news.states)
            kept.since_told += len(news.states)
            many = kept.count > MOST_WAITING
            many = many or (watched and kept.since_told >= self._refresh)
        if many and self._thread is not None:
            self._ask(news.twin_id)

    def reset(self, twin_id: str) -> None:
        """Note that a twin's history has been rewritten or deleted."""
        with self._lock:
            self._kept.pop(twin_id, None)
            self._of_the_past.pop(twin_id, None)
        self._past.forget(twin_id)

    def foresee(
        self, twin_id: str, horizon: float | None, count: int, thresholds: tuple[Limit, ...]
    ) -> CachedForecast | None:
        """Forecast a twin from its cached state; None if there are too few readings.

        The first who asks for a twin waits until it is learnt.

        Parameters
        ----------
        horizon
            Slow time ahead; the default of the registration if None.
        count
            Number of future slow times.
        thresholds
            Limits whose crossing times are wanted.

        Returns
        -------
        The forecast, or None.
        """
        kept = self._up_to_date(twin_id)
        if kept is None:
            return None
        with kept.lock:
            prospect, unit = kept.prospect, kept.unit
            asked = (horizon, count, thresholds)
            known = kept.answers.get(asked)
        if prospect is None:
            return None
        if known is None:
            known = forecast_from_state(prospect, *asked, unit)
            with kept.lock:
                if kept.prospect is prospect and len(kept.answers) < ANSWERS:
                    kept.answers[asked] = known
                self._tell_crossings(twin_id, kept, horizon, known)
        with kept.lock:
            kept.told_states.pop(prospect.since, None)
            kept.told_states[prospect.since] = prospect
            while len(kept.told_states) > TOLD_STATES:
                kept.told_states.pop(next(iter(kept.told_states)))
        return CachedForecast(known, unit)

    def _tell_crossings(
        self, twin_id: str, kept: _CachedForecast, horizon: float | None, told: ChangeForecast
    ) -> None:
        """Take over what a request has computed, so that all say the same of the future."""
        twin = self._pipeline.twin(twin_id)
        if twin is None or horizon != twin.registration.outlook_horizon:
            return
        limits = set(twin.registration.thresholds())
        found = tuple(pair for pair in told.crossings if pair[0] in limits)
        if {limit for limit, _ in found} >= {limit for limit, _ in kept.crossings}:
            kept.crossings = found

    def crossings(self, twin_id: str) -> tuple[tuple[Limit, RemainingLife], ...]:
        """Return when thresholds of a twin are reached, as was told last; nothing is computed.

        Returns
        -------
        None of a twin whose future is not watched, or not known yet.
        """
        kept = self._kept.get(twin_id)
        return () if kept is None else kept.crossings

    def _is_watched(self, twin_id: str) -> bool:
        """Whether the registration of a twin asks for its future."""
        twin = self._pipeline.twin(twin_id)
        if twin is None:
            return False
        known = twin.registration
        return bool(known.thresholds() or known.limit_states or known.decision)

    def _tell_anew(self, twin_id: str, kept: _CachedForecast) -> None:
        """Forecast a twin whose future is watched, though nobody asks."""
        twin = self._pipeline.twin(twin_id)
        if twin is None:
            return
        ahead, limits = twin.registration.outlook_horizon, twin.registration.thresholds()
        told = self.foresee(twin_id, ahead, 1, limits) if limits else None
        with kept.lock:
            kept.crossings = () if told is None else told.foresight.crossings
            kept.since_told = 0
        self._on_renewed(twin_id, None if told is None else told.foresight.since)

    def prospect(self, twin_id: str, since: float | None = None) -> ForecastState | None:
        """Return the cached state of a twin at its last reading; None if readings are few.

        Parameters
        ----------
        since
            Slow time of a reading: the state that a forecast was told of then, if it is still
            kept.
        """
        kept = self._kept.get(twin_id)
        if kept is not None and since is not None:
            with kept.lock:
                told = kept.told_states.get(since)
            if told is not None:
                return told
        kept = self._up_to_date(twin_id)
        return None if kept is None else kept.prospect

    def at(
        self, twin_id: str, t_ns: int | None, slow_time: float | None
    ) -> tuple[ForecastState, str] | None:
        """Compute the forecast state of a twin at an instant, from what had arrived by then.

        It is learnt from as many readings before the moment as today's before now.

        Parameters
        ----------
        twin_id
            SITE.ASSET.
        t_ns
            The instant by sensor time [ns since 1970]; None if given by slow time.
        slow_time
            The instant by slow time; None if given by sensor time.
        """
        twin = self._pipeline.twin(twin_id)
        found = self._store.history(
            twin_id,
            t_ns=(None, t_ns),
            slow_time=(None, slow_time),
            limit=LOOK_BACK,
            newest=True,
        )
        if twin is None or not len(found.states):
            return None
        past = self._state_after(twin, twin_id, found, (t_ns, slow_time))
        if past is None:
            return None
        factors = self._past.factors(twin_id, keys_of(found)[-1])
        state = dataclasses.replace(past.state, widening=factors)
        return state, found.boots[found.number[-1]][1]

    def _state_after(
        self,
        twin: Twin,
        twin_id: str,
        found: StoredHistory,
        until: tuple[int | None, float | None],
    ) -> _PastState | None:
        """Compute the state after the last row of a history, from what was known then."""
        found, changes, renewals = self._since_renewal(
            twin_id, found, int(found.states["t_ns"].max())
        )
        told = self._told_of(twin, twin_id, found, until=until)
        rows = NewestRows.of(found.number, found.states)
        last = learning_mark(rows, changes, told.known, self._refresh)
        learnt_from = learning_input_of(twin, rows, last, changes, told.known)
        kept, known = self._kept.get(twin_id), self._of_the_past.get(twin_id)
        if known is None or known[0] != learnt_from:
            laws = None
            if kept is not None:
                with kept.lock:
                    laws = kept.laws if kept.learnt_from == learnt_from else None
            known = learnt_from, laws or self._learn(twin, found, last, learnt_from)
            if len(self._of_the_past) >= MOST_KEPT:
                self._of_the_past.clear()
            self._of_the_past[twin_id] = known
        state = _forecast_state(twin, found, last, known[1], told.known)
        interrupted = _interrupted(renewals, told.known)
        return None if state is None else _PastState(state, interrupted)

    def keep_outlooks(self, twin_id: str, most: int | None = None) -> bool:
        """State and keep the outlooks of a twin that are due, the oldest first.

        Parameters
        ----------
        most
            At most so many now; None for all.

        Returns
        -------
        Whether more are due.
        """
        twin = self._pipeline.twin(twin_id)
        kept = self._kept.get(twin_id)
        if twin is None or kept is None or not self._outlook_is_due(twin_id, kept):
            return False
        found = self._store.history(twin_id, limit=LOOK_FAR_BACK, newest=True)
        due = self._past.due(twin_id, found, kept.stated)
        for row in due[:most]:
            here = cut(found, row + 1)
            past = self._state_after(
                twin,
                twin_id,
                cut(found, row + 1, LOOK_BACK),
                (int(here.states["t_ns"][-1]), float(here.states["slow_time"][-1])),
            )
            # Of a history that was rewritten meanwhile nothing is kept.
            if self._kept.get(twin_id) is not kept or self._pipeline.twin(twin_id) is None:
                return False
            if past is not None:
                self._past.keep(twin_id, twin, here, past.state, past.interrupted)
            kept.stated = keys_of(here)[-1]
        if most is not None and len(due) > most:
            return True
        if len(found.states):
            kept.stated = keys_of(found)[-1]
        if due:
            self._widen(twin_id, kept)
        return False

    def _outlook_is_due(self, twin_id: str, kept: _CachedForecast) -> bool:
        """Whether one may be due: known from the newest rows where all before were kept."""
        with kept.lock:
            rows, stated = kept.rows, kept.stated
        if rows is None or stated is None:
            return True
        return any(due_at(key) for key in rows.keys[rows.keys > stated].tolist())

    def _widen(self, twin_id: str, kept: _CachedForecast) -> None:
        """Take over the spread that past outlooks call for."""
        with kept.lock:
            last = kept.last
        factors = self._past.factors(twin_id, last)
        with kept.lock:
            if kept.prospect is not None and dict(kept.prospect.widening) != factors:
                kept.prospect = dataclasses.replace(kept.prospect, widening=factors)
                kept.answers.clear()

    def verified(self, twin_id: str) -> Scored | None:
        """Give the kept outlooks of a twin with their scores; None where there are none."""
        twin = self._pipeline.twin(twin_id)
        known = self._past.known(twin_id)
        if twin is None or known is not None or not self._store.outlooks(twin_id, None, 1):
            return known
        found = self._store.history(twin_id, limit=LOOK_FAR_BACK, newest=True)
        if not len(found.states):
            return None
        _, _, renewals = self._since_renewal(twin_id, found)
        told = self._told_of(twin, twin_id, found)
        return self._past.verify(twin_id, twin, found, _interrupted(renewals, told.known))

    def _up_to_date(self, twin_id: str) -> _CachedForecast | None:
        twin = self._pipeline.twin(twin_id)
        if twin is None:
            return None
        kept = self._known(twin_id)
        with kept.lock:
            kept.asked, kept.holder = True, current_holder()
            self._absorb(kept, twin)
            ready = kept.sound and kept.prospect is not None
            due = not kept.sound or kept.learnt_from != self._learning_input(kept, twin)
        if due and (not ready or self._thread is None):
            self._renew(twin_id, kept)
            if self._thread is not None:  # past outlooks are stated behind the answer
                self._ask(twin_id)
        elif due:
            self._ask(twin_id)
        return kept

    def _known(self, twin_id: str) -> _CachedForecast:
        with self._lock:
            kept = self._kept.setdefault(twin_id, _CachedForecast())
            self._kept.move_to_end(twin_id)
            while len(self._kept) > MOST_KEPT:
                self._kept.popitem(last=False)
        return kept

    def _ask(self, twin_id: str) -> None:
        with self._changed:
            self._due.setdefault(twin_id)
            self._changed.notify_all()

    def _absorb(self, kept: _CachedForecast, twin: Twin) -> None:
        """Step through waiting readings; mark the state invalid if their order is broken."""
        waiting, kept.waiting, kept.count = kept.waiting, [], 0
        for news in waiting:
            for name, since in changes_in(body for _, body in news.events):
                kept.changes.setdefault(name, []).append(since)
            if renewals_in(body for _, body in news.events):
                # Of another structure from here on: only what follows is read again.
                kept.sound = False
            if any(TOLD in body for _, body in news.events):
                kept.sound = False
            if not come_after(news.states, kept.told.events):
                # An event is placed after the last reading before it, which is another now.
                kept.sound = False
            if not len(news.states) or not kept.sound or kept.rows is None:
                continue
            numbers = [number for number, _, _ in news.runs]
            first = numbers[0] << SHIFT | int(news.states["sequence"][0])
            past = past_states(twin, news.states, news.bodies)
            try:
                if first <= kept.last:
                    raise ValueError
                if kept.prospect is not None:
                    kept.prospect = advance(kept.prospect, past)
            except ValueError:
                # Readings of an earlier time or place: all is read again, in order.
                kept.sound = False
                continue
            kept.answers.clear()
            kept.rows = kept.rows.with_more(numbers, news.states)
            kept.last, kept.unit = int(kept.rows.keys[-1]), news.runs[-1][2]

    def _learning_input(self, kept: _CachedForecast, twin: Twin) -> LearningInput | None:
        """Make the learning input that the readings so far call for; None without readings."""
        rows = kept.rows
        if rows is None:
            return None
        last = learning_mark(rows, kept.changes, kept.told.known, self._refresh)
        return learning_input_of(twin, rows, last, kept.changes, kept.told.known)

    def _renew(self, twin_id: str, kept: _CachedForecast) -> None:
        """Read the newest part of the history, and learn where it calls for it.

        One at a time: who comes meanwhile finds what the first has learnt.
        """
        with kept.learning:
            twin = self._pipeline.twin(twin_id)
            if twin is None:
                return
            with kept.lock:
                # What has been told is in the history, and is read from it.
                self._absorb(kept, twin)
                if kept.sound and kept.learnt_from == self._learning_input(kept, twin):
                    return
                kept.waiting.clear()
                kept.count = 0
            found = self._store.history(twin_id, limit=LOOK_BACK, newest=True)
            if not len(found.states):
                return
            found, changes, _ = self._since_renewal(twin_id, found)
            told = self._told_of(twin, twin_id, found)
            rows = NewestRows.of(found.number, found.states)
            last = learning_mark(rows, changes, told.known, self._refresh)
            learnt_from = learning_input_of(twin, rows, last, changes, told.known)
            laws = kept.laws
            if learnt_from != kept.learnt_from:
                laws = self._learn(twin, found, last, learnt_from)
            prospect = _forecast_state(twin, found, last, laws, told.known)
            if prospect is not None:
                factors = self._past.factors(twin_id, int(rows.keys[-1]))
                prospect = dataclasses.replace(prospect, widening=factors)
            with kept.lock:
                kept.learnt_from, kept.laws, kept.prospect = learnt_from, laws, prospect
                kept.rows, kept.changes, kept.told = rows, changes, told
                kept.last = int(rows.keys[-1])
                kept.unit = found.boots[found.number[-1]][1]
                kept.sound, kept.asked = True, False
                kept.answers.clear()
                # What came while it was learnt; what is in the history already is passed over.
                kept.waiting = [update_behind(one, kept.last) for one in kept.waiting]
                self._absorb(kept, twin)

    def _learn(
        self, twin: Twin, found: StoredHistory, last: int, learnt_from: LearningInput
    ) -> LearntLaws:
        known = _past_until(twin, found, last + 1)
        process = twin.registration.forecast.process
        learnt: LearntLaws = self._run(
            learn, known, process, dict(learnt_from.suspected), dict(learnt_from.known)
        )
        return learnt

    def _told_of(
        self,
        twin: Twin,
        twin_id: str,
        found: StoredHistory,
        until: tuple[int | None, float | None] = (None, None),
    ) -> _ToldEvents:
        """Place the reported events up to an instant in a history."""
        states = found.states
        rows = self._store.asset_events(twin_id)
        events = effective(row.message for row in rows)
        if rows and until != (None, None):
            last_ns = int(states["t_ns"].max()) if until[0] is None else until[0]
            last = float(states["slow_time"].max()) if until[1] is None else until[1]
            events = [e for e in events if happened_by(e, last_ns, last)]
        if not events:
            return _ToldEvents((), {})
        names = past_states(twin, states[-1:], found.bodies[-1:])
        if not names:
            names = past_states(twin, states, found.bodies)
        known = known_of(events, states["t_ns"], states["slow_time"], names)
        return _ToldEvents(events, known)

    def _since_renewal(
        self, twin_id: str, found: StoredHistory, until_ns: int | None = None
    ) -> tuple[StoredHistory, dict[str, list[float]], list[float]]:
        """Return readings and sudden changes since the last renewal, and all renewals.

        Changes are slow times after which each quantity was told to have gone elsewhere.

        Parameters
        ----------
        until_ns
            Sensor time up to which they had been detected [ns since 1970].
        """
        bodies = [
            row.body
            for row in self._store.events(twin_id, limit=LOOK_BACK, newest=True)
            if until_ns is None or row.t_ns <= until_ns
        ]
        renewals = renewals_in(bodies)
        found = since_last_renewal(found, renewals)
        changes: dict[str, list[float]] = {}
        for name, since in changes_in(bodies):
            changes.setdefault(name, []).append(since)
        return found, changes, renewals

    def _warm(self) -> None:
        """Forecast once, so that compiled code is ready for the first request."""
        time_, noise = np.arange(20.0), 1e-3 * np.random.default_rng(0).standard_normal(20)
        past = {"": Past(time_, noise, np.full(20, 1e-3), 0.0)}
        prospect = forecast_state_of(past, learn(past, "smooth"))
        if prospect is not None:
            forecast_from_state(prospect, 1.0, 2, (Limit("", 0.0),))

    def _catch_up(self, twin_id: str) -> bool:
        """Learn and tell anew where that is due; whether past outlooks wait to be stated."""
        kept, twin = self._kept.get(twin_id), self._pipeline.twin(twin_id)
        if kept is None or twin is None:
            return False
        with kept.lock:
            self._absorb(kept, twin)
            asked, due = kept.asked, kept.since_told >= self._refresh
        watched = due and self._is_watched(twin_id)
        # A twin without requests since it was learnt is not learnt again, unless its future is
        # watched.
        with acting_for(kept.holder):
            if asked or watched:
                self._renew(twin_id, kept)
                if watched:
                    self._tell_anew(twin_id, kept)
            return self.keep_outlooks(twin_id, A_TURN)

    def _work(self) -> None:
        self._warm()
        while not self._stop.is_set():
            with self._changed:
                if not self._due:
                    self._changed.wait(_PAUSE_S)
                twin_id = next(iter(self._due), None)
            if twin_id is None:
                continue
            began_s, more = time.thread_time(), False
            try:
                more = self._catch_up(twin_id)
            except Exception:
                if not self._stop.is_set():
                    logger.exception("Learning the forecast of %s failed; continuing.", twin_id)
            with self._changed:
                self._due.pop(twin_id, None)
                if more:
                    self._due[twin_id] = None  # behind those that wait already
            self._stop.wait(time.thread_time() - began_s)
            while self._pipeline.waiting > BUSY and not self._stop.wait(_PAUSE_S):
                pass


def _interrupted(renewals: Sequence[float], known: KnownEvents) -> list[float]:
    """Slow times of renewals and of told repairs: no outlook from before looks beyond them."""
    return [*renewals, *(at for each in jump_times(known).values() for at in each)]


def _forecast_state(
    twin: Twin, found: StoredHistory, last: int, laws: LearntLaws, known: KnownEvents
) -> ForecastState | None:
    """Take in the readings up to the mark, then those behind it one after the other."""
    prospect = forecast_state_of(_past_until(twin, found, last + 1), laws, known)
    if prospect is None:
        return None
    later = slice(last + 1, None)
    bodies = found.bodies[later] if found.bodies else ()
    try:
        return advance(prospect, past_states(twin, found.states[later], bodies))
    except ValueError:
        # Some of them are of an earlier time: all of them in order.
        return forecast_state_of(_past_until(twin, found, len(found.states)), laws, known)


def _past_until(twin: Twin, found: StoredHistory, count: int) -> dict[str, Past]:
    """Return the past of a twin from its first `count` states of `found`."""
    return past_states(twin, found.states[:count], found.bodies[:count])

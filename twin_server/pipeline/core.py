"""Bus → collect → estimate → persist → acknowledge → tell: the only file that knows the order.

One thread works. Callbacks of the bus leave samples in its inbox; whoever else wants something
changed leaves it a call. What a batch leads to becomes durable in one transaction, and only
then is anything acknowledged, published or shown.
"""

import collections
import concurrent.futures
import json
import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple, Protocol, TypeVar

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Acknowledgement, Event, Features, Registered
from slowtime_schemas.streams import (
    ACK,
    EVENT,
    FEATURES,
    HEALTH,
    REGISTRATION,
    STATE,
    alive_key,
    request_key,
)
from slowtime_services.bus import Bus, Handle, Inbox, Query, Sample, matches
from slowtime_services.clock import Clock, SystemClock
from twin_server.collect import (
    Account,
    Arrival,
    Change,
    Healer,
    Holding,
    Ordered,
    Reception,
    Refusals,
    Run,
    Want,
)
from twin_server.details import Bodies, part
from twin_server.estimate import Checkpoint, Estimated, Twin, estimate
from twin_server.persist import (
    Cut,
    DetailRow,
    EventRow,
    FeatureRow,
    StateRow,
    Store,
    StoreError,
)
from twin_server.registration import Registration
from twin_server.rendering import state_messages
from twin_server.settings import TwinSettings
from twin_server.states import States

from .records import (
    address,
    body_of,
    cut_up,
    decoded,
    derived_event,
    event_row,
    lost_event,
    rows_of_held,
    rows_of_released,
    run_of,
    run_row,
    twin_row,
)

logger = logging.getLogger(__name__)

T = TypeVar("T")
ACK_EVERY_S = 0.1
ANNOUNCE_EVERY_S = 1.0 / (REGISTRATION.nominal_rate_hz or 0.1)
NO_BOOT = "twin"
"""Stands for an edge's boot in what the twin says of its own accord."""
_ANEW = 5_000


class News(NamedTuple):
    """What a batch has brought of one twin, once it is durable."""

    twin_id: str
    states: States
    runs: Sequence[tuple[int, str, str]]
    """Of each state: number and name of its boot, unit of its slow time."""
    events: Sequence[tuple[int, str]]
    bodies: Bodies = ()
    """Of each state of a twin of elements, its detail; empty for other twins."""


class Listener(Protocol):
    """Somebody who wants to know what is new; called by the working thread, must not wait."""

    def tell(self, news: News) -> None:
        """Hear what is new of one twin."""
        ...

    def reset(self, twin_id: str) -> None:
        """Hear that a twin's history has been made anew, or has gone."""
        ...


class Pipeline:
    """The twin server without its door: everything but HTTP.

    Parameters
    ----------
    bus
        Where features come from and states go to; None for a pipeline that is fed by
        `ingest` alone.
    """

    def __init__(
        self,
        settings: TwinSettings,
        store: Store,
        *,
        bus: Bus | None = None,
        clock: Clock | None = None,
    ) -> None:
        self.settings, self.store, self._bus = settings, store, bus
        self._clock = clock or SystemClock()
        self.refusals = Refusals()
        self._reception = Reception(settings.admission, self.refusals)
        self._inbox: Inbox[Sample | None] = Inbox(
            settings.pipeline.inbox_messages, settings.pipeline.inbox_bytes
        )
        self._calls: collections.deque[Callable[[], None]] = collections.deque()
        self._lock = threading.RLock()
        self._listeners: list[Listener] = []
        self._handles: list[Handle] = []
        self._worker: threading.Thread | None = None
        self._healer: Healer | None = None
        self._unacknowledged: dict[Run, None] = {}
        self._acknowledged_s = 0.0
        self._announced_s = 0.0
        self._announcements = 0
        self.counts: collections.Counter[str] = collections.Counter()
        self.failing: str = ""
        self._account = self._new_account()
        self._load()

    def start(self) -> None:
        """Begin to work, and to listen where there is a bus."""
        self._worker = threading.Thread(target=self._work, name="twin", daemon=True)
        self._worker.start()
        if self._bus is None:
            return
        self._healer = Healer(
            self._bus, self.settings.healing, self._wants, self._take_answers, self._settle
        )
        self._handles = [
            self._bus.subscribe(FEATURES.everywhere, self._receive),
            self._bus.subscribe(HEALTH.everywhere, self._receive),
            self._bus.subscribe(REGISTRATION.everywhere, self._receive),
            self._bus.watch(alive_key("*", "*"), self._see),
            self._bus.answer(request_key("*", "*", "registration"), self._answer_registrations),
        ]
        self._healer.start()

    def stop(self) -> None:
        """Listen no more, finish what has arrived, and end."""
        for handle in self._handles:
            handle.close()
        self._handles.clear()
        if self._healer is not None:
            self._healer.stop()
        self._inbox.close()
        if self._worker is not None:
            self._worker.join()
            self._worker = None

    @property
    def working(self) -> bool:
        """Whether the working thread lives."""
        return self._worker is not None and self._worker.is_alive()

    def ingest(self, samples: Iterable[Sample]) -> None:
        """Take samples straight in, without a bus; back once they are durable.

        A recording that is read from its beginning to its end is followed by `give_up`, which
        passes over what it does not hold.
        """
        batch: list[Sample] = []
        for sample in samples:
            batch.append(sample)
            if len(batch) == self.settings.pipeline.batch_messages:
                taken, batch = batch, []
                self.call(lambda taken=taken: self._take(taken))  # type: ignore[misc]
        self.call(lambda: self._take(batch))

    def give_up(self) -> None:
        """Wait for nothing that is missing any more."""
        self.call(lambda: self._durably(self._account.give_up))

    def register(self, twin_id: str, registration: Registration) -> bool:
        """Register a twin, new or anew; True where it is new.

        One that has a history is estimated anew from its features, from the first on.
        """
        return self.call(lambda: self._register(twin_id, registration))

    def delete(self, twin_id: str) -> bool:
        """Forget a twin, its history and its account; False where there is none."""
        return self.call(lambda: self._delete(twin_id))

    def listen(self, listener: Listener) -> None:
        """Tell `listener` what is new, from now on."""
        self._listeners.append(listener)

    def call(self, function: Callable[[], T]) -> T:
        """Do something between two batches, and wait for it."""
        if not self.working or threading.current_thread() is self._worker:
            with self._lock:
                return function()
        future: concurrent.futures.Future[T] = concurrent.futures.Future()

        def run() -> None:
            try:
                future.set_result(function())
            except BaseException as error:
                future.set_exception(error)

        self._later(run)
        return future.result()

    def twin(self, twin_id: str) -> Twin | None:
        """One twin as its features have left it."""
        return self._twins.get(address(twin_id))

    def is_alive(self, twin_id: str) -> bool:
        """Whether the edge of a twin is there."""
        return self._account.is_alive(*address(twin_id))

    def gauges(self) -> dict[str, int]:
        """How things are now, for those who measure."""
        account = self._account
        return {
            "twins": len(self._twins),
            "edges_alive": len(account.alive),
            "holes": account.holes,
            "held": account.held,
            "inbox": len(self._inbox),
        }

    def tallies(self) -> dict[str, int]:
        """Give what others have counted for the pipeline."""
        return {
            "asked": self._healer.asked if self._healer else 0,
            "inbox_dropped": self._inbox.dropped,
        }

    def _later(self, call: Callable[[], None]) -> None:
        self._calls.append(call)
        self._inbox.put(None)

    def _receive(self, sample: Sample) -> None:
        """Enqueue, nothing else: this is a thread of the bus."""
        size = len(sample.payload)
        if self._reception.admits(sample) and not self._inbox.put(sample, size):
            self.refusals.refuse(
                "inbox_full",
                f"{len(self._inbox):,} messages wait already. Allowed: what fits the inbox "
                "settings. Nothing is lost: edges are asked again.",
            )

    def _see(self, key: str, alive: bool) -> None:
        """Note that an edge appears or goes."""
        site, asset = key.split("/")[-3:-1]
        if alive_key(site, asset) == key:
            self._later(lambda: self._account.watch(site, asset, alive=alive))

    def _work(self) -> None:
        limit = self.settings.pipeline.batch_messages
        while True:
            wait_s = ACK_EVERY_S if self._unacknowledged else 0.25
            samples = self._inbox.take(limit, timeout_s=wait_s)
            with self._lock:
                while self._calls:
                    self._guarded(self._calls.popleft())
                real = [sample for sample in samples if sample is not None]
                if real:
                    self._guarded(lambda real=real: self._take(real))  # type: ignore[misc]
                self._guarded(self._acknowledge)
                self._guarded(self._announce_all)
            if self._inbox.closed and not samples and not self._calls:
                return

    def _guarded(self, function: Callable[[], None]) -> None:
        """Go on whatever happens."""
        try:
            function()
        except Exception:
            logger.exception("Something failed; going on from what is durable.")

    def _durably(self, function: Callable[[Change], None]) -> None:
        """Do something to the account, and conclude; where that fails, it never happened."""
        change = Change()
        try:
            function(change)
            self._conclude(change)
            self.failing = ""
        except Exception as error:
            self.counts["failed_batches"] += 1
            self.failing = f"{type(error).__name__}: {error}"
            self._load()
            raise

    def _load(self) -> None:
        """Go on from what is durable."""
        alive = self._account.alive
        self._account = self._new_account()
        self._twins = {
            (row.site, row.asset): Twin(
                Registration.from_json(row.registration), Checkpoint.from_json(row.checkpoint)
            )
            for row in self.store.twins()
        }
        rows, following = self.store.runs()
        runs = {row.number: run_of(row) for row in rows}
        self._units = {row.number: row.slow_time_unit for row in rows}
        for number, sequence, payload in self.store.held():
            runs[number].held[sequence] = Arrival(decoded(payload), payload)
        self._unacknowledged.clear()
        self._account.restore(runs.values(), following)
        for twin_id in alive:
            self._account.watch(*address(twin_id), alive=True)

    def _new_account(self) -> Account:
        return Account(
            self.settings.healing,
            max_jump=self.settings.admission.max_jump,
            alone=self._bus is None,
        )

    def _take(self, samples: Sequence[Sample]) -> None:
        """One batch, from bytes to history."""
        arrivals, healths, registrations = self._reception.read(samples, self._clock.now_ns())
        for twin_id, registration in registrations:
            self._register(twin_id, registration, "by a recording")
        if not self.settings.auto_register:
            arrivals = [a for a in arrivals if self._is_registered(a.features)]
            healths = [h for h in healths if (h[0].site, h[0].asset) in self._twins]
        self._take_arrivals(arrivals)
        if healths:
            self._durably(lambda c: self._account.hear(healths, time.monotonic(), c))

    def _take_arrivals(self, arrivals: Sequence[Arrival]) -> None:
        """Order, estimate and keep; one that cannot be worked does not stop the others."""
        try:
            self._durably(lambda c: self._account.take(arrivals, time.monotonic(), c))
        except StoreError:
            raise
        except Exception as error:
            if len(arrivals) > 1:
                middle = len(arrivals) // 2
                self._take_arrivals(arrivals[:middle])
                self._take_arrivals(arrivals[middle:])
                return
            logger.exception("Features could not be worked.")
            features = arrivals[0].features
            self.refusals.refuse(
                "failed",
                f"{features.twin_id}: sequence {features.sequence} made the server fail: "
                f"{error!r}. Please report it, with the message.",
            )

    def _is_registered(self, features: Features) -> bool:
        registered = (features.site, features.asset) in self._twins
        if not registered:
            self.refusals.refuse(
                "not_registered",
                f"Features of {features.twin_id} were given. Allowed: those of registered "
                f"twins. PUT /api/v1/twins/{features.twin_id}, or set auto_register.",
            )
        return registered

    def _conclude(self, change: Change) -> None:
        """Estimate, make durable, and only then tell anybody."""
        for reason, sentence in change.refused:
            self.refusals.refuse(reason, sentence)
        self._unacknowledged.update(change.touched)
        if not (change.ordered or change.touched or change.lost or change.held):
            return
        cut = Cut(held=rows_of_held(change), released=rows_of_released(change))
        twins = dict(self._twins)
        found, owners, keys = self._estimate(change.ordered, twins, cut)
        cut.events += [lost_event(lost) for lost in change.lost]
        cut.runs += [
            run_row(run, self._units.get(run.number, "s"))
            for run in change.touched
            if run.number
        ]
        numbers = self.store.write(cut)
        self._twins = twins
        self._count(change, cut)
        self._tell(change.ordered, found, owners, keys, cut, numbers)

    def _estimate(
        self,
        ordered: Sequence[Ordered],
        twins: dict[tuple[str, str], Twin],
        cut: Cut,
    ) -> tuple[Estimated, list[int], list[tuple[str, str]]]:
        """Add states, checkpoints and events of `ordered` to `cut`, checkpoints to `twins`."""
        keys: dict[tuple[str, str], int] = {}
        owners = [keys.setdefault((o.run.site, o.run.asset), len(keys)) for o in ordered]
        for run in {id(o.run): o for o in ordered}.values():
            self._units.setdefault(run.run.number, run.features.slow_time_unit)
        for key in keys:
            if key not in twins:
                registration = self.settings.default_registration
                twins[key] = Twin(registration, Checkpoint.start(registration))
                cut.events.append(self._registered(*key, registration, "by its first features"))
                cut.twins.append(twin_row(key, twins[key]))
        found = estimate(
            [twins[key] for key in keys],
            [o.features for o in ordered],
            owners,
            [o.missing_before for o in ordered],
        )
        for key, checkpoint, notices in zip(
            keys, found.checkpoints, found.notices, strict=True
        ):
            if checkpoint != twins[key].checkpoint:
                twins[key] = twins[key]._replace(checkpoint=checkpoint)
                cut.twins.append(twin_row(key, twins[key]))
            cut.events += [derived_event(ordered[n.row].features, n) for n in notices]
        cut.features += [
            FeatureRow(
                o.run.number, o.features.sequence, o.features.t_ns, o.features.slow_time,
                o.payload, state,
            )
            for o, state in zip(ordered, cut_up(found.states), strict=True)
        ]  # fmt: skip
        cut.details += [
            DetailRow(o.run.number, o.features.sequence, *detail)
            for o, detail in zip(ordered, found.details, strict=False)
            if detail is not None
        ]
        return found, owners, list(keys)

    def _count(self, change: Change, cut: Cut) -> None:
        self.counts["batches"] += 1
        self.counts["accepted"] += len(change.ordered)
        self.counts["out_of_order"] += change.early
        self.counts["lost"] += sum(lost.last - lost.first + 1 for lost in change.lost)
        for event in cut.events:
            self.counts[f"event_{json.loads(event.body)['kind']}"] += 1

    def _tell(
        self,
        ordered: Sequence[Ordered],
        found: Estimated,
        owners: Sequence[int],
        keys: Sequence[tuple[str, str]],
        cut: Cut,
        numbers: Sequence[int],
    ) -> None:
        """Publish and show what has just become durable."""
        states = found.states
        events: dict[tuple[str, str], list[tuple[int, str]]] = {}
        for number, event in zip(numbers, cut.events, strict=True):
            events.setdefault((event.site, event.asset), []).append((number, event.body))
            self._publish(
                EVENT.key(event.site, event.asset), event.body.encode(), EVENT.encoding
            )
        rows: list[list[int]] = [[] for _ in keys]
        for row, owner in enumerate(owners):
            rows[owner].append(row)
        all_of_them = len(ordered) <= self.settings.pipeline.states_per_batch
        for key, of_twin in zip(keys, rows, strict=True):
            theirs = states[of_twin]
            runs = [
                (run.number, run.boot, self._units[run.number])
                for run in (ordered[row].run for row in of_twin)
            ]
            bodies = [body_of(found.details[row]) for row in of_twin] if found.details else ()
            shown = slice(None) if all_of_them else slice(-1, None)
            if self._bus is not None:
                _, boots, units = zip(*runs[shown], strict=True)
                for message in state_messages(
                    theirs[shown], *key, boots, units, part(bodies, shown)
                ):
                    self._publish(STATE.key(*key), message, STATE.encoding)
            news = News(".".join(key), theirs, runs, events.pop(key, ()), bodies)
            for listener in self._listeners:
                listener.tell(news)
        for key, happened in events.items():
            for listener in self._listeners:
                listener.tell(News(".".join(key), states[:0], (), happened))

    def _publish(self, key: str, payload: bytes, encoding: str) -> None:
        if self._bus is None:
            return
        try:
            self._bus.publish(key, payload, encoding=encoding)
            self.counts["published"] += 1
        except Exception:
            # History is durable and REST answers: a bus that fails stops nothing else.
            self.counts["not_published"] += 1
            logger.exception("A message on %s could not be published.", key)

    def _acknowledge(self) -> None:
        """Tell edges what is durable: at once when idle, else a few times a second."""
        now = time.monotonic()
        if not self._unacknowledged or now - self._acknowledged_s < ACK_EVERY_S:
            return
        self._acknowledged_s = now
        runs, self._unacknowledged = self._unacknowledged, {}
        for run in runs:
            if run.number and run.next:
                ack = Acknowledgement(
                    site=run.site,
                    asset=run.asset,
                    boot=run.boot,
                    sequence=run.next - 1,
                    t_ns=self._clock.now_ns(),
                )
                self._publish(ACK.key(run.site, run.asset), encode(ack), ACK.encoding)

    def _wants(self) -> list[Want]:
        return self.call(lambda: self._account.wants(time.monotonic()))

    def _take_answers(self, want: Want, samples: Sequence[Sample]) -> bool:
        def take() -> bool:
            self._take(samples)
            return self._account.still_missing(want)

        return self.call(take)

    def _settle(self, want: Want, listing: Sequence[Holding] | None, sound: bool) -> None:
        now_s = time.monotonic()
        self.call(
            lambda: self._durably(
                lambda c: self._account.settle(want, listing, now_s, c, sound=sound)
            )
        )

    def _register(
        self, twin_id: str, registration: Registration, how: str = "by request"
    ) -> bool:
        key = address(twin_id)
        before = self._twins.get(key)
        if before is not None and before.registration == registration:
            return False
        event = self._registered(*key, registration, how)
        if before is None:
            twin = Twin(registration, Checkpoint.start(registration))
            self.store.write(Cut(twins=[twin_row(key, twin)], events=[event]))
        else:
            twin = self._estimate_anew(key, registration, event)
        self._twins[key] = twin
        self._announce(key)
        for listener in self._listeners:
            listener.reset(twin_id)
        return before is None

    def _announce_all(self) -> None:
        """Say now and then how twins are registered, for recorders that began since."""
        now = time.monotonic()
        if now - self._announced_s < ANNOUNCE_EVERY_S:
            return
        self._announced_s = now
        for key in self._twins:
            self._announce(key)

    def _announce(self, key: tuple[str, str]) -> None:
        twin = self._twins[key]
        self._publish(
            REGISTRATION.key(*key), self._registered_as(key, twin), REGISTRATION.encoding
        )

    def _answer_registrations(self, query: Query) -> Iterator[tuple[str, bytes]]:
        """Say how twins are registered to somebody who asks; in a thread of the bus."""
        for key, twin in list(self._twins.items()):
            if matches(query.key, request_key(*key, "registration")):
                yield REGISTRATION.key(*key), self._registered_as(key, twin)

    def _registered_as(self, key: tuple[str, str], twin: Twin) -> bytes:
        site, asset = key
        self._announcements += 1
        message = Registered(
            site=site,
            asset=asset,
            boot=NO_BOOT,
            sequence=self._announcements,
            t_ns=self._clock.now_ns(),
            id=f"{site}.{asset}",
            registration=twin.registration.to_dict(),
        )
        return encode(message)

    def _estimate_anew(
        self, key: tuple[str, str], registration: Registration, event: EventRow
    ) -> Twin:
        """Make all states of a twin from its features again; in memory, a part at a time."""
        twin = Twin(registration, Checkpoint.start(registration))
        events = [event]

        def states() -> Iterator[StateRow]:
            nonlocal twin
            last = (0, -1)
            while rows := self.store.messages(".".join(key), last, _ANEW):
                features = [decoded(row.message) for row in rows]
                missing = []
                for row in rows:
                    before = last[1] if row.number == last[0] else -1
                    missing.append(row.sequence - before - 1)
                    last = (row.number, row.sequence)
                found = estimate([twin], features, [0] * len(rows), missing)
                twin = twin._replace(checkpoint=found.checkpoints[0])
                events.extend(derived_event(features[n.row], n) for n in found.notices[0])
                details = found.details or [None] * len(rows)
                for row, state, detail in zip(rows, cut_up(found.states), details, strict=True):
                    yield StateRow(row.number, row.sequence, state, detail)

        self.store.rewrite(".".join(key), states(), lambda: (twin_row(key, twin), events))
        return twin

    def _registered(
        self, site: str, asset: str, registration: Registration, how: str
    ) -> EventRow:
        return event_row(
            Event(
                site=site,
                asset=asset,
                boot=NO_BOOT,
                sequence=0,
                t_ns=self._clock.now_ns(),
                kind="registered",
                severity="info",
                message=f"Registered {how}: what may change is {registration.changes}.",
                details=registration.to_dict(),
            ),
            derived=False,
        )

    def _delete(self, twin_id: str) -> bool:
        key = address(twin_id)
        existed = self.store.delete(twin_id)
        self._twins.pop(key, None)
        self._account.forget(*key)
        for listener in self._listeners:
            listener.reset(twin_id)
        return existed

"""Runs collect, estimate, persist, acknowledge and publish, in this order.

One thread works. Callbacks of the bus leave samples in its inbox; whoever else wants something
changed leaves it a call. What a batch leads to becomes durable in one transaction, and only
then is anything acknowledged, published or shown.
"""

import collections
import concurrent.futures
import contextlib
import functools
import json
import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, TypeVar

from slowtime_schemas.asset_events import AssetEvent
from slowtime_schemas.messages import Features, Health, Link, Virtual
from slowtime_schemas.streams import (
    ASSET_EVENT,
    FATIGUE,
    FEATURES,
    HEALTH,
    REGISTRATION,
    VIRTUAL,
    address_of,
    alive_key,
    request_key,
)
from slowtime_services.bus import (
    Bus,
    Handle,
    Inbox,
    Query,
    Sample,
    TwoVersionBus,
    UnpackingBus,
    matches,
)
from slowtime_services.clock import Clock, SystemClock
from slowtime_services.credentials import Signer
from slowtime_services.supervision import all_stacks
from twin_server.collect import (
    Account,
    Arrival,
    Backfill,
    EdgeQuery,
    Holding,
    Received,
    Reception,
    Refusals,
    SensorWatch,
    StoreChange,
)
from twin_server.estimate import Checkpoint, Twin
from twin_server.events.asset_events import MOST_KEPT, AssetEventRow
from twin_server.events.deliveries import AlarmAcknowledgement, Delivery
from twin_server.notify.witnesses import HeadWitnesses
from twin_server.persist import EventRow, Store, StoreError, WriteBatch
from twin_server.pipeline.progress import Phase
from twin_server.registration.changes import (
    DISPLAYED,
    Author,
    change_details,
    changed_fields,
)
from twin_server.registration.twin import Registration
from twin_server.settings import TwinSettings

from .accepted import RangeProver, contest_repeated
from .assessed import AssessedMessages
from .asset_limit import AssetLimit
from .estimation import (
    EMPTY_ESTIMATE,
    estimate_next,
    interrupted_event,
    new_twin,
    note_event,
    reestimate,
    registration_event,
)
from .failure_log import FailureLog
from .heard import Heard
from .leader_election import LeaderElection
from .ledger_signer import LedgerSigner
from .repeated_windows import WindowNotices
from .routing import Routing
from .rows import (
    address,
    asset_event_row,
    decoded,
    doubted_event,
    limit_event,
    lost_event,
    old_event,
    rivals_event,
    rows_of_held,
    rows_of_released,
    run_of,
    run_row,
    told_event,
    twin_row,
)
from .set_aside import QuarantineFullError, SettingAside
from .state_publisher import ACK_EVERY_S, StatePublisher
from .updates import UpdateListener
from .window_coverage import WindowCoverage

logger = logging.getLogger(__name__)

MOST_RECALLED = 10_000
"""Events of before that are looked through for what was told of a sensor."""

T = TypeVar("T")
Answered = tuple[EdgeQuery, Sequence[Holding] | None, bool]
"""What was asked, what the edge says it holds, and whether all was answered."""


class Pipeline:
    """The twin server without HTTP.

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
        self.settings, self.store = settings, store
        self._bus = None if bus is None else TwoVersionBus(UnpackingBus(bus))
        self._clock = clock or SystemClock()
        self.refusals = Refusals()
        self.setting_aside = SettingAside(store, settings.progress, self.refusals)
        self._progress = self.setting_aside.progress
        self._reception = Reception(settings.admission, self.refusals)
        self._inbox: Inbox[Sample] = Inbox(
            settings.pipeline.inbox_messages, settings.pipeline.inbox_bytes
        )
        self._calls: collections.deque[Callable[[], None]] = collections.deque()
        self._takes_calls, self._calling = False, threading.Lock()
        self._pressing, self._next_s = threading.Event(), 0.0
        self._answered: collections.deque[Answered] = collections.deque()
        self._lock = threading.RLock()
        self._handles: list[Handle] = []
        self._worker: threading.Thread | None = None
        self._backfill: Backfill | None = None
        self.counts: collections.Counter[str] = collections.Counter()
        self._election = LeaderElection(bus, self._clock, settings.shards.share)
        self._publisher = StatePublisher(
            self._bus,
            self._clock,
            self.counts,
            settings.pipeline.states_per_batch,
            self._election,
            RangeProver(store).range_of,
        )
        self.failing, self.stalled = "", ""
        self._failing_since_s: float | None = None
        self._failure_log = FailureLog()
        # A pipeline without a bus reads recordings, whose events are not delivered.
        self.routing = Routing(settings.alarms, listening=bus is not None)
        self._account = self._new_account()
        self._limit = AssetLimit(settings.admission.max_assets_of_site, self.refusals)
        self._stale, self._hurried = True, False
        self._heard: dict[tuple[str, str], Heard] = {}
        self._links: dict[tuple[str, str], Link] = {}
        self._assessed = AssessedMessages(store)
        self._sensors = SensorWatch(self._told_of_sensor)
        self.ledger_signer: LedgerSigner | None = None
        if settings.ledger.key is not None:
            signer = Signer.read(settings.ledger.key)
            self.ledger_signer = LedgerSigner(
                store,
                self._clock,
                signer,
                settings.ledger,
                self._publisher.say,
                HeadWitnesses(settings.ledger),
            )
        self._load()

    def start(self) -> None:
        """Begin to work, and to listen where there is a bus."""
        self._worker = threading.Thread(target=self._run, name="twin", daemon=True)
        self._takes_calls = True
        self._election.start()
        self._worker.start()
        if self._bus is None:
            return
        self._backfill = Backfill(
            self._bus, self.settings.healing, self._wants, self._take_answers, self._settle
        )
        self._handles = [
            self._bus.subscribe(FEATURES.everywhere, self._receive),
            self._bus.subscribe(HEALTH.everywhere, self._receive),
            self._bus.subscribe(FATIGUE.everywhere, self._receive),
            self._bus.subscribe(VIRTUAL.everywhere, self._receive),
            self._bus.subscribe(REGISTRATION.everywhere, self._receive),
            self._bus.subscribe(ASSET_EVENT.everywhere, self._receive),
            self._bus.watch(alive_key("*", "*"), self._see),
            self._bus.answer(request_key("*", "*", "registration"), self._answer_registrations),
        ]
        self._backfill.start()

    def stop(self, within_s: float | None = None) -> None:
        """Stop listening, finish the messages that have arrived, and end.

        Parameters
        ----------
        within_s
            How long that may take [s]; what is not finished then waits at the edges, which
            have no acknowledgement of it.
        """
        for handle in self._handles:
            handle.close()
        self._handles.clear()
        if self._backfill is not None:
            self._backfill.stop()
        self._inbox.close()
        self._pressing.set()
        if self._worker is not None:
            self._worker.join(within_s)
            self._hurried = True
            self._worker.join(within_s)
            if self._worker.is_alive():
                logger.error("The pipeline does not end; its stack:\n%s", all_stacks())
            self._worker = None
        self._election.stop()

    @property
    def working(self) -> bool:
        """Whether the working thread lives."""
        return self._worker is not None and self._worker.is_alive()

    @property
    def waits(self) -> bool:
        """Whether messages or calls wait to be worked."""
        return bool(self._inbox) or bool(self._calls)

    def stall(self, trouble: str, by_message: bool) -> None:
        """Give up the claim to lead, from another thread: the pipeline stands still.

        Parameters
        ----------
        trouble
            Sentence that says so.
        by_message
            Whether it stands still while it works on messages, which is noted then.
        """
        self.stalled = trouble
        if by_message:
            self.setting_aside.attempts.mark()
        self._election.resign()

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
        most = self.settings.pipeline.inbox_messages
        self.call(lambda: self._durably(self._account.give_up, most))

    def register(
        self,
        twin_id: str,
        registration: Registration,
        kind: str = "registered",
        message: str = "",
        details: Mapping[str, Any] | None = None,
        author: Author | None = None,
    ) -> bool:
        """Register a twin for the first time or again; return True if it is new.

        One that has a history is estimated anew from its features, from the first on, unless
        no estimate depends on what is changed.

        Parameters
        ----------
        kind, message, details
            Of the event that says so; left out, that of any registration.
        author
            Who changes it, for this event.
        """
        because = (kind, message, details) if message else None
        return self.call(
            lambda: self._register(twin_id, registration, because=because, author=author)
        )

    def note(
        self,
        twin_id: str,
        kind: str,
        severity: Literal["info", "warning", "alarm"],
        message: str,
        details: Mapping[str, Any],
    ) -> None:
        """Store and publish an event that does not follow from features."""
        self.call(lambda: self._note(twin_id, kind, severity, message, details))

    def keep(
        self,
        event: EventRow,
        deliveries: Sequence[Delivery] = (),
        settled: Sequence[Delivery] = (),
        acknowledgements: Sequence[AlarmAcknowledgement] = (),
        asset_events: Sequence[AssetEventRow] = (),
    ) -> None:
        """Store an event with its dependent rows, and publish it."""
        self.call(
            lambda: self._keep([event], deliveries, settled, acknowledgements, asset_events)
        )

    def record(self, told: AssetEvent) -> AssetEventRow:
        """Record an event of an asset, and publish it."""
        return self.call(lambda: self._record(told))

    def delete(self, twin_id: str) -> bool:
        """Forget a twin, its history and its account; False where there is none."""
        return self.call(lambda: self._delete(twin_id))

    def listen(self, listener: UpdateListener) -> None:
        """Pass updates of twins to `listener` from now on."""
        self._publisher.listen(listener)

    def call(self, function: Callable[[], T]) -> T:
        """Do something between two batches, and wait for it."""
        future: concurrent.futures.Future[T] = concurrent.futures.Future()

        def run() -> None:
            try:
                future.set_result(function())
            except BaseException as error:
                future.set_exception(error)

        if threading.current_thread() is not self._worker and self._later(run):
            return future.result()
        with self._lock:
            return function()

    def twin(self, twin_id: str) -> Twin | None:
        """One twin as its features have left it."""
        return self._twins.get(address(twin_id))

    def is_alive(self, twin_id: str) -> bool:
        """Whether the edge of a twin is there."""
        return self._account.is_alive(*address(twin_id))

    def heard_ns(self, twin_id: str) -> int | None:
        """When features of a twin last came; None where not since this server began."""
        heard = self._heard.get(address(twin_id))
        return None if heard is None else heard.at_ns

    def late_s(self, twin_id: str) -> int:
        """How long the next reading of a twin is overdue [s]; 0 where it is not."""
        heard, link = self._heard.get(address(twin_id)), self._links.get(address(twin_id))
        gathered_s = 0.0 if link is None else link.features_within_s
        return 0 if heard is None else heard.late_s(self._clock.now_ns(), gathered_s)

    def link(self, twin_id: str) -> Link | None:
        """Return what the edge of a twin said last of its link; None where it says nothing."""
        return self._links.get(address(twin_id))

    def sensor(self, twin_id: str) -> dict[str, int] | None:
        """Return the latest counters of the live sensor of a twin; None without one."""
        return self._sensors.of(*address(twin_id))

    @property
    def trouble(self) -> str:
        """Describe another twin server that was first on the bus; empty without one."""
        return self._election.trouble

    @property
    def ledger_refusal(self) -> str:
        """Why heads are not signed any more; empty where all is well, or there is no key."""
        return "" if self.ledger_signer is None else self.ledger_signer.refusal

    @property
    def waiting(self) -> int:
        """Number of messages in the inbox."""
        return len(self._inbox)

    def gauges(self) -> dict[str, int]:
        """Return the gauges of the pipeline, for metrics."""
        account = self._account
        return {
            "twins": len(self._twins),
            "edges_alive": len(account.alive),
            "holes": account.holes,
            "held": account.held,
            "held_bytes": account.held_bytes,
            "boots": account.boots,
            "inbox": self.waiting,
            "ledger_refused": int(bool(self.ledger_refusal)),
            "aside": self.setting_aside.quarantine.gauge(),
        }

    def tallies(self) -> dict[str, int]:
        """Return counts of other parts of the pipeline."""
        return {
            "asked": self._backfill.asked if self._backfill else 0,
            "inbox_dropped": self._inbox.dropped,
            "witness_failures": self.ledger_signer.missed if self.ledger_signer else 0,
        }

    def _later(self, call: Callable[[], None]) -> bool:
        """Leave the worker a call; False where there is none that would see to it."""
        with self._calling:
            if not self._takes_calls:
                return False
            self._calls.append(call)
        self._inbox.wake()
        self._pressing.set()
        return True

    def _receive(self, sample: Sample) -> None:
        """Enqueue, nothing else: this is a thread of the bus."""
        size = len(sample.payload)
        came = sample._replace(arrived_ns=self._clock.now_ns())
        if self._reception.admits(sample) and not self._inbox.put(came, size):
            self.refusals.refuse(
                "inbox_full",
                f"{len(self._inbox):,} messages are waiting already, which is the limit "
                "of the inbox settings. Nothing is lost: the edge agents will be asked "
                "to resend.",
            )

    def _see(self, key: str, alive: bool) -> None:
        """Note that an edge appears or disappears."""
        if (of := address_of(key)) is not None and alive_key(*of) == key:
            self._later(lambda: self._watch(of, alive))

    def _watch(self, of: tuple[str, str], alive: bool) -> None:
        if not alive or self._limit.admits(of, self._account, self._twins):
            self._account.watch(*of, alive=alive)

    def _run(self) -> None:
        try:
            self._work()
        finally:  # whatever ended it: somebody waits for each call
            with self._calling:
                self._takes_calls = False
            with self._lock:
                while self._calls:
                    self._guarded(self._calls.popleft())

    def _may_end(self) -> bool:
        """Take no more calls, unless some are due."""
        with self._calling:
            self._takes_calls = bool(self._calls)
            return not self._takes_calls

    def _work(self) -> None:
        limit = self.settings.pipeline.batch_messages
        while True:
            samples: list[Sample] = []
            if self._gathered(limit):
                wait_s = ACK_EVERY_S if self._publisher.owes else 0.25
                samples = self._inbox.take(limit, timeout_s=wait_s)
            with self._lock:
                while self._calls:
                    with self._progress.doing(Phase.STORE):
                        self._guarded(self._calls.popleft())
                if not self._account.corrections.is_empty:
                    self._guarded(self._keep_corrections)
                if samples:
                    self._next_s = time.monotonic() + self.settings.pipeline.gather_s
                    self._guarded(functools.partial(self._take, samples))
                with self._progress.doing(Phase.STORE):
                    if not self._resigned():
                        self._guarded(self._election.step)
                    if not self._stale:  # else the account counts what is not durable
                        self._guarded(self._publisher.acknowledge)
                    self._guarded(lambda: self._publisher.announce_all(self._twins))
                    self._guarded(self._sign_ledger)
                    self._guarded(self._tell_interruption)
            if self._hurried or (
                self._inbox.closed and not samples and not self._inbox and self._may_end()
            ):
                self._guarded(lambda: self._sign_ledger(at_once=True))
                return

    def _resigned(self) -> bool:
        """Whether this server gives up its claim to lead, because nothing succeeds any more."""
        if not self.failing:
            self._failing_since_s = None
            return False
        now_s = time.monotonic()
        if self._failing_since_s is None:
            self._failing_since_s = now_s
        if now_s - self._failing_since_s < self.settings.progress.silent_s:
            return False
        self._election.resign()
        return True

    def _gathered(self, limit: int) -> bool:
        """Let messages gather for a batch, unless there are enough; False if calls are due."""
        self._pressing.clear()
        wait_s = self._next_s - time.monotonic()
        if wait_s <= 0 or self._inbox.closed or len(self._inbox) >= limit:
            return True
        if not self._calls:
            self._pressing.wait(wait_s)
        return not self._calls

    def _sign_ledger(self, *, at_once: bool = False) -> None:
        """Sign a head of the ledger where it is due; tell the twins that cannot be proven."""
        if self.ledger_signer is None or self._stale:
            return
        if at_once:
            self.ledger_signer.close()
        else:
            self.ledger_signer.step()
        for twin_id, message in self.ledger_signer.take_unsaid().items():
            self._note(twin_id, "ledger_refused", "alarm", message, {})

    def _tell_interruption(self) -> None:
        """Tell twins whose readings came while the database took nothing, once it does."""
        if (over := self._failure_log.over) is None:
            return
        now_ns = self._clock.now_ns()
        since_ns = now_ns - round(1e9 * (time.monotonic() - over.began_s))
        events = [
            interrupted_event(*key, over.took_s, now_ns)
            for key in self._twins
            if key in self._heard and self._heard[key].at_ns >= since_ns
        ]
        if events:
            self._keep(events, self.routing.deliveries(events, self._twins, now_ns))
        self._failure_log.over = None

    def _guarded(self, function: Callable[[], object]) -> None:
        """Go on whatever happens."""
        try:
            function()
        except StoreError as error:
            self._failure_log.say(str(error))
        except Exception:
            logger.exception("Processing a batch failed; continuing from the durable state.")

    def _durably(self, function: Callable[[StoreChange], None], messages: int = 1) -> None:
        """Do something to the account, and conclude; where that fails, it never happened.

        Parameters
        ----------
        messages
            How many messages it concerns, of which its budget follows.
        """
        change = StoreChange()
        try:
            if self._stale:
                self._load()
            self.setting_aside.budget.run(lambda: function(change), messages)
            self._conclude(change)
            self.failing = ""
            self._failure_log.clear()
        except Exception as error:
            self.counts["failed_batches"] += 1
            self.failing = f"{type(error).__name__}: {error}"
            # Until it can be read again what is durable, nothing may be built on the account.
            self._stale = True
            with contextlib.suppress(StoreError):
                self._load()
            raise

    def _load(self) -> None:
        """Restore the durable state."""
        alive = self._account.alive
        account = self._new_account()
        twins = {
            (row.site, row.asset): Twin(
                Registration.from_json(row.registration), Checkpoint.from_json(row.checkpoint)
            )
            for row in self.store.twins()
        }
        rows, following = self.store.runs()
        runs = {row.number: run_of(row) for row in rows}
        for number, sequence, payload in self.store.held():
            runs[number].held[sequence] = Arrival(decoded(payload), payload)
        account.restore(runs.values(), following)
        for twin_id in alive:
            account.watch(*address(twin_id), alive=True)
        self._publisher.forget_owed()
        self._account, self._twins = account, twins
        self._coverage = WindowCoverage(self.store)
        self._window_notices = WindowNotices(self.store, self.refusals)
        self._units = {row.number: row.slow_time_unit for row in rows}
        self._stale = False

    def _keep_corrections(self) -> None:
        """Store and report what was corrected of the restored account."""
        found, self._account.corrections = self._account.corrections, StoreChange()
        for one in found.doubted:
            logger.warning(
                "The account of %s was corrected: it had sequence %d, and %d is expected. Its "
                "readings are taken in from there on, and nothing is counted as lost.",
                one.run,
                one.stated,
                one.expected,
            )

        def keep(change: StoreChange) -> None:
            change.doubted += found.doubted
            change.released += found.released
            change.touched.update(found.touched)

        self._durably(keep)

    def _new_account(self) -> Account:
        return Account(
            self.settings.healing,
            max_jump=self.settings.admission.max_jump,
            max_boots=self.settings.admission.max_boots,
            alone=self._bus is None,
        )

    def _take(self, samples: Sequence[Sample]) -> int:
        """Process messages; return the number of those from senders with wrong clocks."""
        usual, suspected = self.setting_aside.divided(samples)
        misdated = self._take_batch(usual) if usual else 0
        for sample in suspected:
            misdated += self._take_batch([sample])
        return misdated

    def _take_batch(self, samples: Sequence[Sample]) -> int:
        """Process one batch, which is noted meanwhile."""
        aside, now_ns = self.setting_aside, self._clock.now_ns()
        if len(samples) == 1 and aside.refuses(samples[0], now_ns):
            return 0
        noted = aside.attempts.noted(sample.payload for sample in samples)
        with self._progress.doing(Phase.STORE), noted:
            return self._take_noted(samples)

    def _take_noted(self, samples: Sequence[Sample]) -> int:
        with self._progress.doing(Phase.STEP):
            received = self._reception.read(samples, self._clock.now_ns())
        # What a replay holds comes once: one part that fails must not cost the others.
        self._run_each(
            functools.partial(self._take_features, received),
            functools.partial(self._take_assessed, received),
            functools.partial(self._take_healths, received),
            *(functools.partial(self._take_told, told) for told in received.asset_events),
        )
        return received.misdated

    def _run_each(self, *parts: Callable[[], object]) -> None:
        """Run all parts, whichever of them fails; then raise the first failure."""
        failures: list[Exception] = []
        for part in parts:
            try:
                part()
            except Exception as error:
                failures.append(error)
        if failures:
            self.failing = f"{type(failures[0]).__name__}: {failures[0]}"
            raise failures[0]

    def _take_features(self, received: Received) -> None:
        """Take registrations, and the features that may follow from them."""
        arrivals = received.arrivals
        for twin_id, registration in received.registrations:
            self._register(twin_id, registration, "by a recording")
        if not self.settings.auto_register:
            arrivals = [a for a in arrivals if self._is_registered(a.features)]
        else:
            messages = [a.features for a in arrivals]
            allowed = self._limit.allowed(messages, self._account, self._twins)
            arrivals = [
                a for a, is_allowed in zip(arrivals, allowed, strict=True) if is_allowed
            ]
        now_ns = self._clock.now_ns()
        for one in arrivals:
            key = one.features.site, one.features.asset
            self._heard[key] = Heard.next(self._heard.get(key), one.features.t_ns, now_ns)
        self._take_arrivals(self.setting_aside.admitted(arrivals))
        self._account.disbelieve(received.disbelieved)

    def _take_assessed(self, received: Received) -> None:
        if kept := self._assessed.take(received.assessed, self._twins):
            self.counts["fatigue"] += kept

    def _take_healths(self, received: Received) -> None:
        healths = received.healths
        if not self.settings.auto_register:
            healths = [h for h in healths if (h[0].site, h[0].asset) in self._twins]
        else:
            messages = [health for health, _ in healths]
            allowed = self._limit.allowed(messages, self._account, self._twins)
            healths = [h for h, is_allowed in zip(healths, allowed, strict=True) if is_allowed]
        if not healths:
            return
        live = [health for health, replayed in healths if not replayed]
        self._hear_of_links(live)
        self._run_each(
            lambda: self._durably(lambda c: self._account.hear(healths, time.monotonic(), c)),
            lambda: self._hear_of_sensors(live),
        )

    def _hear_of_links(self, healths: Sequence[Health]) -> None:
        """Keep what agents say of their links: when their messages are to be expected."""
        for health in healths:
            key = health.site, health.asset
            if health.link is None:
                self._links.pop(key, None)
            else:
                self._links[key] = health.link

    def virtual(self, twin_id: str) -> list[Virtual]:
        """Latest windows of virtual quantities, since this server began."""
        return self._assessed.virtual(address(twin_id))

    def _hear_of_sensors(self, healths: Sequence[Health]) -> None:
        """Make events of live sensors, all in one transaction; for registered twins only."""
        theirs = [health for health in healths if (health.site, health.asset) in self._twins]
        try:
            notices = self._sensors.hear(theirs, time.monotonic())
            now_ns = self._clock.now_ns()
            events = [note_event(*notice, now_ns) for notice in notices]
            if events:
                deliveries = self.routing.deliveries(events, self._twins, now_ns)
                self._keep(events, deliveries)
        except StoreError:
            for health in theirs:
                self._sensors.forget(health.site, health.asset)  # told once it can be kept
            raise

    def _told_of_sensor(self, site: str, asset: str) -> Iterator[dict[str, Any]]:
        """Return stored sensor events of a twin, the newest first."""
        rows = self.store.events(f"{site}.{asset}", limit=MOST_RECALLED, newest=True)
        return (json.loads(row.body) for row in reversed(rows))

    def _take_arrivals(self, arrivals: Sequence[Arrival]) -> None:
        """Order, estimate and keep; one that cannot be worked does not stop the others."""
        try:
            now_s = time.monotonic()
            self._durably(lambda c: self._account.take(arrivals, now_s, c), len(arrivals))
        except StoreError:
            raise
        except Exception as error:
            if len(arrivals) > 1:
                middle = len(arrivals) // 2
                self._take_arrivals(arrivals[:middle])
                self._take_arrivals(arrivals[middle:])
                return
            if isinstance(error, QuarantineFullError):
                return
            logger.exception("Features could not be processed.")
            features = arrivals[0].features
            if event := self.setting_aside.failed(arrivals[0], error, self._clock.now_ns()):
                self._keep([event])
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

    def _conclude(self, change: StoreChange) -> None:
        """Estimate, store, and only then publish."""
        contest_repeated(self.store, change)
        for reason, sentence in change.refused:
            self.refusals.refuse(reason, sentence)
        if change.is_empty:
            return
        cut = WriteBatch(held=rows_of_held(change), released=rows_of_released(change))
        # Not a copy of all: a batch concerns a few twins of a hundred thousand.
        changed: dict[tuple[str, str], Twin] = {}
        twins = collections.ChainMap(changed, self._twins)
        for run in {id(o.run): o for o in change.ordered}.values():
            self._units.setdefault(run.run.number, run.features.slow_time_unit)
        windows = self._coverage.sort(change.ordered)
        change.ordered = windows.new
        cut.events += self._window_notices.of(windows)
        aside, now_ns = self.setting_aside, self._clock.now_ns()
        with aside.attempts.noted_too(o.payload for o in change.ordered):
            fresh = estimate_next(
                change.ordered,
                twins,
                cut,
                self.settings.default_registration,
                now_ns,
                aside.estimating,
            )
        cut.aside, set_aside = aside.rows(change.ordered, fresh, now_ns)
        cut.events += set_aside
        cut.events += [lost_event(lost) for lost in change.lost]
        cut.events += [old_event(aged) for aged in change.aged]
        cut.events += [rivals_event(rivals) for rivals in change.rivals]
        cut.events += [doubted_event(doubted) for doubted in change.doubted]
        cut.events += [limit_event(one, self._clock.now_ns()) for one in change.limits]
        cut.runs += [
            run_row(run, self._units.get(run.number, "s"))
            for run in change.touched
            if run.number
        ]
        self.routing.hear(change.ordered)
        cut.deliveries += self.routing.deliveries(cut.events, twins, self._clock.now_ns())
        with self._progress.doing(Phase.STORE):
            numbers = self.store.write(cut)
        for row in cut.aside:
            aside.quarantine.note(row)
        self._publisher.owe(change.touched)
        self._twins.update(changed)
        self._count(change, cut)
        self._publisher.tell(change.ordered, fresh, self._units, cut.events, numbers)

    def _count(self, change: StoreChange, cut: WriteBatch) -> None:
        self.counts["batches"] += 1
        self.counts["accepted"] += len(change.ordered)
        self.counts["out_of_order"] += change.early
        self.counts["overlapping"] += sum(one.covered > 0.0 for one in change.ordered)
        self.counts["lost"] += sum(lost.last - lost.first + 1 for lost in change.lost)
        for event in cut.events:
            self.counts[f"event_{json.loads(event.body)['kind']}"] += 1

    def _wants(self) -> list[EdgeQuery]:
        return self.call(lambda: self._account.wants(time.monotonic()))

    def _take_answers(self, want: EdgeQuery, samples: Sequence[Sample]) -> tuple[bool, bool]:
        def take() -> tuple[bool, bool]:
            misdated = self._take(samples)
            return self._account.still_missing(want), misdated == 0

        return self.call(take)

    def _settle(self, want: EdgeQuery, listing: Sequence[Holding] | None, sound: bool) -> None:
        """Store the answers of many edges together, because each commit waits for the disk."""
        self._answered.append((want, listing, sound))
        self._later(self._settle_all)

    def _settle_all(self) -> None:
        answered = [self._answered.popleft() for _ in range(len(self._answered))]
        if answered:
            try:
                self._conclude_answers(answered)
            finally:
                if self._backfill is not None:
                    self._backfill.wake()

    def _conclude_answers(self, answered: Sequence[Answered]) -> None:
        """Store all at once, or by halves: an answer that fails does not stop the others."""

        def settle(change: StoreChange) -> None:
            now_s = time.monotonic()
            for want, listing, sound in answered:
                self._account.settle(want, listing, now_s, change, sound=sound)

        try:
            self._durably(settle)
        except StoreError:
            raise
        except Exception:
            if len(answered) == 1:
                raise
            middle = len(answered) // 2
            self._conclude_answers(answered[:middle])
            self._conclude_answers(answered[middle:])

    def _note(
        self,
        twin_id: str,
        kind: str,
        severity: Literal["info", "warning", "alarm"],
        message: str,
        details: Mapping[str, Any],
    ) -> None:
        key = address(twin_id)
        if key not in self._twins:
            return
        now_ns = self._clock.now_ns()
        event = note_event(*key, kind, severity, message, details, now_ns)
        self._keep([event], self.routing.deliveries([event], self._twins, now_ns))

    def _keep(
        self,
        events: Sequence[EventRow],
        deliveries: Sequence[Delivery] = (),
        settled: Sequence[Delivery] = (),
        acknowledgements: Sequence[AlarmAcknowledgement] = (),
        asset_events: Sequence[AssetEventRow] = (),
    ) -> None:
        """Store events with their dependent rows, and publish them."""
        cut = WriteBatch(
            events=list(events),
            deliveries=list(deliveries),
            settled=list(settled),
            acknowledgements=list(acknowledgements),
            asset_events=list(asset_events),
        )
        numbers = self.store.write(cut)
        for event in events:
            self.counts[f"event_{json.loads(event.body)['kind']}"] += 1
        self._publisher.tell((), EMPTY_ESTIMATE, self._units, events, numbers)
        for row in asset_events:
            key = ASSET_EVENT.key(*address(row.twin))
            self._publisher.say(key, row.body.encode(), ASSET_EVENT.encoding)

    def _record(self, told: AssetEvent) -> AssetEventRow:
        row, event = asset_event_row(told), told_event(told)
        deliveries = self.routing.deliveries([event], self._twins, row.t_ns)
        self._keep([event], deliveries, asset_events=[row])
        return row

    def _take_told(self, told: AssetEvent) -> None:
        """Store an event of a replayed recording; one that is known is skipped."""
        if address(told.twin_id) not in self._twins:
            self.refusals.refuse(
                "not_registered",
                f"An event of {told.twin_id} was played. Allowed: those of registered twins.",
            )
            return
        rows = self.store.asset_events(told.twin_id)
        if len(rows) < MOST_KEPT and all(row.event != told.event for row in rows):
            number = 1 + max((row.number for row in rows), default=0)
            self._record(told.model_copy(update={"sequence": number}))

    def _register(
        self,
        twin_id: str,
        registration: Registration,
        how: str = "by request",
        *,
        because: tuple[str, str, Mapping[str, Any] | None] | None = None,
        author: Author | None = None,
    ) -> bool:
        key = address(twin_id)
        before = self._twins.get(key)
        if before is not None and before.registration == registration:
            return False
        now_ns = self._clock.now_ns()
        if because is None:
            change = (
                None
                if before is None or author is None
                else change_details(before.registration, registration, author)
            )
            event = registration_event(*key, registration, how, now_ns, change)
        else:
            kind, message, details = because
            event = note_event(*key, kind, "info", message, details or {}, now_ns)
        if before is None:
            twin = new_twin(registration)
            self.store.write(WriteBatch(twins=[twin_row(key, twin)], events=[event]))
        elif DISPLAYED.issuperset(changed_fields(before.registration, registration)):
            twin = before._replace(registration=registration)
            self.store.write(WriteBatch(twins=[twin_row(key, twin)], events=[event]))
        else:
            twin = reestimate(
                self.store, key, registration, event, self.setting_aside.estimating
            )
        self.replace(twin_id, twin)
        self._publisher.announce(key, twin)
        return before is None

    def replace(self, twin_id: str, twin: Twin) -> None:
        """Take over a twin that was estimated anew, in the thread of the pipeline."""
        self._twins[address(twin_id)] = twin
        self._publisher.reset(twin_id)

    def _answer_registrations(self, query: Query) -> Iterator[tuple[str, bytes]]:
        """Answer queries for registrations; in a thread of the bus."""
        if self._election.first is not None:
            return  # the first twin server answers
        for key, twin in list(self._twins.items()):
            if matches(query.key, request_key(*key, "registration")):
                yield REGISTRATION.key(*key), self._publisher.registration(key, twin)

    def _delete(self, twin_id: str) -> bool:
        key = address(twin_id)
        existed = self.store.delete(twin_id)
        self._twins.pop(key, None)
        self._heard.pop(key, None)
        self._links.pop(key, None)
        self._assessed.forget(key)
        self._sensors.forget(*key)
        for number in self._account.forget(*key):
            self._units.pop(number, None)
        self.routing.forget(key)
        self.setting_aside.quarantine.load()
        self._publisher.reset(twin_id)
        return existed

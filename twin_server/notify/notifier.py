"""Hands due deliveries to their senders, and records the outcome of each attempt.

Whatever is begun is in the store before it is tried, and stays there as waiting until an
outcome is durable: a server that is killed in between sends the same message again, under the
same identity.
"""

import logging
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Protocol

from slowtime_services.clock import Clock
from twin_server.events.deliveries import Delivery, happened_ns, subject
from twin_server.events.receivers import AlarmSettings

from .backoff import LONGEST_WAIT_S, retry_delay_s
from .receiver_queue import Attempted, ReceiverQueue
from .senders import Sender

logger = logging.getLogger(__name__)

LOOK_S = 1.0
"""How often it is looked for what has become due, where nothing else happens."""

MIND_S = 5.0
"""How often it is looked at what waits for something else than its time."""

FORGET_S = 3_600.0
"""Interval at which old deliveries are dropped [s]."""

_LATE = 1_000
"""Late deliveries that are looked at in one turn."""

_AFTER_TROUBLE_S = 1.0
"""Pause after a failure of the store [s]."""


class DeliveryStore(Protocol):
    """Deliveries as the notifier reads and settles them."""

    def due(self, receiver: str, now_ns: int, limit: int) -> Sequence[Delivery]:
        """Deliveries that wait and are due, the earliest first."""
        ...

    def late(self, limit: int) -> Sequence[Delivery]:
        """Deliveries of readings that were old on arrival, those that came last."""
        ...

    def waiting(self, limit: int) -> Sequence[Delivery]:
        """Deliveries that wait for their time, those that were begun last."""
        ...

    def unsendable(self, receivers: Sequence[str], before_ns: int) -> Sequence[Delivery]:
        """Deliveries to none of these receivers, that have waited since then."""
        ...

    def settle(self, settled: Sequence[Delivery], begun: Sequence[Delivery] = ()) -> None:
        """Store outcomes of deliveries, and begin others."""
        ...

    def give_up(self, delivery: Delivery) -> None:
        """Store that a delivery has failed for good, with an event that reports it."""
        ...

    def holds(self, delivery: Delivery) -> bool:
        """Whether the alarm is still raised and not acknowledged."""
        ...

    def is_fresh(self, delivery: Delivery) -> bool:
        """Whether the newest reading of its twin is live and not old."""
        ...

    def forget(self, before_ns: int) -> None:
        """Delete deliveries that ended before an instant."""
        ...


class Notifier:
    """Sends deliveries that are due, in threads of its own.

    Parameters
    ----------
    senders
        By the names of their receivers.
    """

    def __init__(
        self,
        settings: AlarmSettings,
        store: DeliveryStore,
        senders: Mapping[str, Sender],
        clock: Clock,
    ) -> None:
        self._settings, self._store, self._clock = settings, store, clock
        self._outcomes: list[Attempted] = []
        self._lock = threading.Lock()
        self._wake, self._stop = threading.Event(), threading.Event()
        self._minded_s = self._forgot_s = -1e9
        self._queues = {
            name: ReceiverQueue(
                name, sender, settings.receivers[name].concurrency, settings, self._hear
            )
            for name, sender in senders.items()
        }
        self._thread = threading.Thread(target=self._run, name="notify", daemon=True)

    def start(self) -> None:
        """Begin to send."""
        for queue in self._queues.values():
            queue.start()
        self._thread.start()

    def stop(self, timeout_s: float = 3.0) -> None:
        """Send no more; wait briefly for deliveries in progress and store their outcome.

        Parameters
        ----------
        timeout_s
            Longest time to wait [s].
        """
        self._stop.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()
        until_s = time.monotonic() + timeout_s
        for queue in self._queues.values():
            queue.stop()
        for queue in self._queues.values():
            queue.join(max(0.0, until_s - time.monotonic()))
        try:
            self._settle()
        except Exception:
            logger.exception(
                "Outcomes of the last deliveries could not be stored; they will be sent again."
            )

    def wake(self) -> None:
        """Check for due deliveries at once."""
        self._wake.set()

    def _hear(self, outcome: Attempted) -> None:
        with self._lock:
            self._outcomes.append(outcome)
        self._wake.set()

    def _run(self) -> None:
        while not self._stop.is_set():
            pause = LOOK_S
            try:
                self._turn()
            except Exception:
                logger.exception("Checking for due deliveries failed; trying again.")
                pause = _AFTER_TROUBLE_S
                self._stop.wait(pause)
            self._wake.wait(pause)
            self._wake.clear()

    def _turn(self) -> None:
        self._settle()
        now_s = time.monotonic()
        if now_s - self._minded_s > MIND_S:
            self._minded_s = now_s
            self._mind()
        if now_s - self._forgot_s > FORGET_S:
            self._forgot_s = now_s
            self._store.forget(self._now_ns() - round(self._settings.kept_s * 1e9))
        for name, queue in self._queues.items():
            if queue.room > 0:
                for one in self._store.due(name, self._now_ns(), queue.held + queue.room):
                    self._begin(queue, one)

    def _begin(self, queue: ReceiverQueue, delivery: Delivery) -> None:
        """Hand a delivery to its receiver's queue; a reminder only of a raised alarm."""
        if delivery.reminder and not self._store.holds(delivery):
            self._store.settle([self._ended(delivery, "It has ended, or was acknowledged.")])
            return
        queue.give(delivery)

    def _settle(self) -> None:
        """Store the outcomes of attempts, all at once."""
        with self._lock:
            outcomes = list(self._outcomes)
        if not outcomes:
            return
        now_ns = self._now_ns()
        settled = [self._after(outcome, now_ns) for outcome in outcomes]
        reminders = [
            one.reminding(now_ns)
            for one in settled
            if one.state == "delivered" and one.remind_s
        ]
        self._store.settle([one for one in settled if one.state != "failed"], reminders)
        for one in settled:
            if one.state == "failed":
                self._store.give_up(one)
        with self._lock:
            del self._outcomes[: len(outcomes)]
        for one in settled:
            self._queues[one.receiver].settled(one)

    def _after(self, outcome: Attempted, now_ns: int) -> Delivery:
        """Return a delivery after an attempt: delivered, waiting for the next, or failed."""
        before = outcome.delivery
        tries = before.tries + 1
        if outcome.delivered:
            return before._replace(
                state="delivered", tries=tries, ended_ns=now_ns, error=outcome.said
            )
        pause = max(retry_delay_s(self._settings, before.id, tries), outcome.wait_s)
        due_ns = now_ns + round(pause * 1e9)
        failed = before._replace(tries=tries, error=outcome.said, due_ns=due_ns)
        if due_ns - before.created_ns > self._settings.max_age_s * 1e9:
            return failed._replace(state="failed", ended_ns=now_ns)
        return failed

    def _mind(self) -> None:
        """Handle late deliveries, and those without a receiver."""
        now_ns = self._now_ns()
        oldest_ns = now_ns - round(self._settings.max_age_s * 1e9)
        seen: set[tuple[object, ...]] = set()
        for one in sorted(self._store.late(_LATE), key=happened_ns, reverse=True):
            if not self._store.holds(one):
                self._store.settle([self._ended(one, "It had ended when it could be told.")])
            elif (about := subject(one)) in seen:
                self._store.settle([self._ended(one, "A newer one tells the same.")])
            elif self._store.is_fresh(one):
                seen.add(about)
                self._store.settle([one._replace(state="waiting", due_ns=now_ns)])
            elif one.created_ns < oldest_ns:
                self._store.settle([self._ended(one, "No newer reading has come.")])
            else:
                seen.add(about)
        self._bring_forward(now_ns)
        for one in self._store.unsendable(list(self._queues), oldest_ns):
            why = f"No receiver is called {one.receiver} any more."
            self._store.give_up(one._replace(state="failed", ended_ns=now_ns, error=why))

    def _bring_forward(self, now_ns: int) -> None:
        """Try now what would wait longer than any pause, because the clock was set back."""
        for one in self._store.waiting(_LATE):
            pause_s = max(self._settings.max_backoff_s, one.remind_s or 0.0, LONGEST_WAIT_S)
            if one.due_ns > now_ns + round(pause_s * 1e9):
                self._store.settle([one._replace(due_ns=now_ns)])

    def _ended(self, one: Delivery, why: str) -> Delivery:
        return one._replace(state="dropped", ended_ns=self._now_ns(), error=why)

    def _now_ns(self) -> int:
        return self._clock.now_ns()

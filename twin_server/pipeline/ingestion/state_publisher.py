"""Publishes durable states and events on the bus, acknowledges runs and informs listeners."""

import collections
import json
import logging
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Acknowledgement, Registered
from slowtime_schemas.streams import ACK, EVENT, REGISTRATION, STATE
from slowtime_services.bus import Bus
from slowtime_services.clock import Clock
from slowtime_services.digests import written
from twin_server.collect import Ordered, Run
from twin_server.estimate import Twin
from twin_server.history.details import part
from twin_server.history.rendering import state_messages
from twin_server.persist import EventRow

from .estimation import NO_BOOT, BatchEstimate
from .leader_election import LeaderElection
from .rows import address, body_of
from .updates import TwinUpdate, UpdateListener

logger = logging.getLogger(__name__)

ACK_EVERY_S = 0.1
"""Interval at which runs are acknowledged, at least [s]."""

ANNOUNCE_EVERY_S = 1.0 / (REGISTRATION.nominal_rate_hz or 0.1)
"""Interval at which a registration is announced [s], up to 1,000 twins."""

ANNOUNCED_PER_S = 100.0
"""Most registrations announced in a second [1/s].

One costs 50 to 80 µs of processor time, so that they take less than 1 % of a core. Of 100,000
twins each is announced every 1,000 s. Recorders ask for all of them when they begin.
"""


class AcknowledgedRange(NamedTuple):
    """Last acknowledged sequence of a run, and the digest of its features from `first` on."""

    sequence: int
    first: int | None
    digest: int


class StatePublisher:
    """Publishes states and events, acknowledges runs, announces registrations.

    Parameters
    ----------
    bus
        None for a pipeline that is fed by hand.
    election
        Whether another twin server speaks on this bus.
    prove
        Says what to acknowledge of a run; None where that needs another round.
    counts
        Where it counts what was published and what was not.
    states_per_batch
        Of a larger batch, only the newest state of each twin is published.
    """

    def __init__(
        self,
        bus: Bus | None,
        clock: Clock,
        counts: collections.Counter[str],
        states_per_batch: int,
        election: LeaderElection,
        prove: Callable[[Run], AcknowledgedRange | None],
    ) -> None:
        self._bus, self._clock, self._counts = bus, clock, counts
        self._election, self._prove = election, prove
        self._states_per_batch = states_per_batch
        self._listeners: list[UpdateListener] = []
        self._owed: dict[Run, None] = {}
        self._acknowledged_s = 0.0
        self._announced_s = -ANNOUNCE_EVERY_S
        self._due = 0.0
        self._in_turn: collections.deque[tuple[str, str]] = collections.deque()
        self._announcements = 0

    def listen(self, listener: UpdateListener) -> None:
        """Pass updates of twins to `listener` from now on."""
        self._listeners.append(listener)

    def tell(
        self,
        ordered: Sequence[Ordered],
        fresh: BatchEstimate,
        units: Mapping[int, str],
        happened: Sequence[EventRow],
        numbers: Sequence[int],
    ) -> None:
        """Publish what has just become durable."""
        found = fresh.found
        events: dict[tuple[str, str], list[tuple[int, str]]] = {}
        for number, event in zip(numbers, happened, strict=True):
            events.setdefault((event.site, event.asset), []).append((number, event.body))
            self._publish(
                EVENT.key(event.site, event.asset), event.body.encode(), EVENT.encoding
            )
        updates = _updates(ordered, fresh, units, events)
        if self._bus is not None:
            self._publish_states(updates, len(ordered) > self._states_per_batch)
        for news in updates:
            for listener in self._listeners:
                listener.tell(news)
        for key, others in events.items():
            for listener in self._listeners:
                listener.tell(TwinUpdate(".".join(key), found.states[:0], (), others))

    def _publish_states(self, updates: Sequence[TwinUpdate], newest_only: bool) -> None:
        """Publish the states of all twins, or the newest of each, rendered in one go."""
        shown = slice(-1, None) if newest_only else slice(None)
        parts = [news.states[shown] for news in updates]
        addresses, boots, units = [], [], []
        bodies: list[bytes | None] = []
        for news, states in zip(updates, parts, strict=True):
            addresses += [address(news.twin_id)] * len(states)
            boots += [boot for _, boot, _ in news.runs[shown]]
            units += [unit for *_, unit in news.runs[shown]]
            bodies += part(news.bodies, shown) or [None] * len(states)
        if parts:
            together = np.concatenate(parts)
            messages = state_messages(together, addresses, boots, units, bodies)
            for key, message in zip(addresses, messages, strict=True):
                self._publish(STATE.key(*key), message, STATE.encoding)

    def reset(self, twin_id: str) -> None:
        """Note that a twin's history has been rewritten or deleted."""
        for listener in self._listeners:
            listener.reset(twin_id)

    @property
    def owes(self) -> bool:
        """Whether something durable has not been acknowledged yet."""
        return bool(self._owed)

    def owe(self, runs: Iterable[Run]) -> None:
        """Note runs whose features have become durable."""
        self._owed.update(dict.fromkeys(runs))

    def forget_owed(self) -> None:
        """Acknowledge nothing of a cut that failed."""
        self._owed.clear()

    def acknowledge(self) -> None:
        """Acknowledge durable features: at once when idle, else a few times a second."""
        now = time.monotonic()
        if not self._owed or now - self._acknowledged_s < ACK_EVERY_S:
            return
        if not self._election.acknowledges:
            return
        self._acknowledged_s = now
        runs, self._owed = self._owed, {}
        for run in runs:
            if run.number and run.next and not run.contested:
                proof = self._prove(run)
                if proof is None:
                    self._owed[run] = None
                    continue
                ack = acknowledgement(run, proof, self._clock.now_ns())
                self._publish(ACK.key(run.site, run.asset), ack, ACK.encoding)

    def announce_all(self, twins: Mapping[tuple[str, str], Twin]) -> None:
        """Publish some registrations in turn, for recordings that began since.

        All are published within `ANNOUNCE_EVERY_S`, or as soon as `ANNOUNCED_PER_S` allows,
        spread evenly over that time.
        """
        now_s = time.monotonic()
        per_s = min(len(twins) / ANNOUNCE_EVERY_S, ANNOUNCED_PER_S)
        most = min(len(twins), ANNOUNCED_PER_S)  # after a pause as well
        self._due = min(self._due + (now_s - self._announced_s) * per_s, most)
        self._announced_s = now_s
        if self._bus is None or self._election.first is not None:
            return
        while self._due >= 1.0:
            self._due -= 1.0
            if not self._in_turn:
                self._in_turn.extend(twins)
            key = self._in_turn.popleft()
            if key in twins:
                self.announce(key, twins[key])

    def announce(self, key: tuple[str, str], twin: Twin) -> None:
        """Publish the registration of a twin."""
        self._publish(
            REGISTRATION.key(*key), self.registration(key, twin), REGISTRATION.encoding
        )

    def registration(self, key: tuple[str, str], twin: Twin) -> bytes:
        """Write the message of a twin's registration."""
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

    def say(self, key: str, payload: bytes, encoding: str) -> None:
        """Publish a message of another part of the server."""
        self._publish(key, payload, encoding)

    def _publish(self, key: str, payload: bytes, encoding: str) -> None:
        if self._bus is None or self._election.first is not None:
            return
        try:
            self._bus.publish(key, payload, encoding=encoding)
            self._counts["published"] += 1
        except Exception:
            # History is durable and REST answers: a bus that fails stops nothing else.
            self._counts["not_published"] += 1
            logger.exception("A message on %s could not be published.", key)


def _updates(
    ordered: Sequence[Ordered],
    fresh: BatchEstimate,
    units: Mapping[int, str],
    events: dict[tuple[str, str], list[tuple[int, str]]],
) -> list[TwinUpdate]:
    """Make the update of each twin that has new states, with its events, which are used up."""
    found = fresh.found
    rows: list[list[int]] = [[] for _ in fresh.keys]
    for row, owner in enumerate(fresh.owners):
        rows[owner].append(row)
    states = found.states[[row for of_twin in rows for row in of_twin]]
    updates, begin = [], 0
    for key, of_twin in zip(fresh.keys, rows, strict=True):
        runs = [
            (run.number, run.boot, units[run.number])
            for run in (ordered[row].run for row in of_twin)
        ]
        bodies = [body_of(found.details[row]) for row in of_twin] if found.details else ()
        theirs = states[begin : begin + len(of_twin)]
        updates.append(TwinUpdate(".".join(key), theirs, runs, events.pop(key, ()), bodies))
        begin += len(of_twin)
    return updates


def acknowledgement(run: Run, proof: AcknowledgedRange, now_ns: int) -> bytes:
    """Write the acknowledgement of a boot in the version that its agent reads."""
    ack = Acknowledgement(
        site=run.site,
        asset=run.asset,
        boot=run.boot,
        sequence=proof.sequence,
        t_ns=now_ns,
        first=proof.first,
        digest=None if proof.first is None else written(proof.digest),
    )
    if run.ack_version >= Acknowledgement.VERSION:
        return encode(ack)
    return json.dumps(ack.model_dump(exclude={"first", "digest"}) | {"version": 1}).encode()

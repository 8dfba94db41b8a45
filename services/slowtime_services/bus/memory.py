"""The bus within one process."""

import logging
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Self

from slowtime_services.clock import Clock, SystemClock

from .keys import check_key, matches
from .protocol import MOST_ANSWER_BYTES, Answers, BusClosedError, Query, Sample

logger = logging.getLogger(__name__)

Handler = Callable[[Query], Iterable[tuple[str, bytes]]]


class _Declaration:
    """One subscription, queryable, token or watch, in the table it is kept in."""

    def __init__(
        self, table: "list[_Declaration]", key: str, callback: object, bus: "MemoryBus"
    ):
        self.key, self.callback, self.bus = key, callback, bus
        self._table = table

    def close(self) -> None:
        self.bus._withdraw(self._table, self)


class _Network:
    """State that the buses of one process share."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.subscribers: list[_Declaration] = []
        self.answerers: list[_Declaration] = []
        self.tokens: list[_Declaration] = []
        self.watchers: list[_Declaration] = []


class MemoryBus:
    """Messages handed over within one process.

    Delivery happens in the publisher's thread, before `publish` returns: what was published
    has arrived, and tests need not wait.

    Parameters
    ----------
    clock
        Stamps `sent_ns`.
    joins
        Another in-memory bus whose network to join, as a second process would; each closes
        only what it declared itself.
    """

    def __init__(self, *, clock: Clock | None = None, joins: "MemoryBus | None" = None) -> None:
        self._clock = clock or SystemClock()
        self._network: _Network = joins._network if joins else _Network()
        self._closed = False
        self._callback_errors = 0

    @property
    def callback_errors(self) -> int:
        """Number of exceptions raised by callbacks and handlers of this bus."""
        return self._callback_errors

    @property
    def watch_delay_s(self) -> float:
        """None: `watch` reports present processes before it returns."""
        return 0.0

    def publish(
        self, key: str, payload: bytes, *, encoding: str, replayed: bool = False
    ) -> None:
        """Send to every subscriber, in the order they subscribed; back once all have it."""
        self._check_open()
        sample = Sample(
            check_key(key, wildcards=False), bytes(payload), self._clock.now_ns(), replayed
        )
        for declared in tuple(self._network.subscribers):
            if matches(declared.key, key):
                declared.bus._call(declared.callback, sample)

    def subscribe(
        self, key_expression: str, callback: Callable[[Sample], None]
    ) -> _Declaration:
        """Call `callback` for each message on `key_expression`."""
        return self._declare(self._network.subscribers, key_expression, callback)

    def answer(self, key: str, handler: Handler) -> _Declaration:
        """Answer questions on `key` with the pairs that `handler` gives."""
        return self._declare(self._network.answerers, key, handler)

    def ask(
        self,
        key_expression: str,
        parameters: Mapping[str, str] | None = None,
        *,
        timeout_s: float = 2.0,
        max_bytes: int = MOST_ANSWER_BYTES,
    ) -> Answers:
        """All answers that come within `timeout_s`."""
        self._check_open()
        query = Query(check_key(key_expression, wildcards=True), dict(parameters or {}))
        asked = [d for d in tuple(self._network.answerers) if matches(d.key, key_expression)]
        return _gather(
            [
                lambda d=d: d.bus._reply(d.callback, query, max_bytes)  # type: ignore[misc]
                for d in asked
            ],
            timeout_s,
        )

    def announce(self, key: str) -> _Declaration:
        """Be alive under `key` until the handle, or this bus, is closed."""
        check_key(key, wildcards=False)
        with self._network.lock:
            first = not any(token.key == key for token in self._network.tokens)
            token = self._declare(self._network.tokens, key, None)
            if first:
                self._tell_watchers(key, alive=True)
        return token

    def watch(self, key_expression: str, callback: Callable[[str, bool], None]) -> _Declaration:
        """Call `callback(key, alive)` for those alive now and for each change."""
        with self._network.lock:
            declared = self._declare(self._network.watchers, key_expression, callback)
            for key in dict.fromkeys(token.key for token in self._network.tokens):
                if matches(key_expression, key):
                    self._call(callback, key, True)
        return declared

    def close(self) -> None:
        """Withdraw everything this bus declared."""
        self._closed = True
        network = self._network
        for table in (
            network.tokens,
            network.watchers,
            network.answerers,
            network.subscribers,
        ):
            for declared in tuple(table):
                if declared.bus is self:
                    declared.close()

    def __enter__(self) -> Self:
        """Return the bus."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()

    def _check_open(self) -> None:
        if self._closed:
            raise BusClosedError

    def _declare(self, table: list[_Declaration], key: str, callback: object) -> _Declaration:
        self._check_open()
        declared = _Declaration(table, check_key(key, wildcards=True), callback, self)
        with self._network.lock:
            table.append(declared)
        return declared

    def _withdraw(self, table: list[_Declaration], declared: _Declaration) -> None:
        with self._network.lock:
            if declared not in table:
                return
            table.remove(declared)
            last = not any(other.key == declared.key for other in table)
            if table is self._network.tokens and last:
                self._tell_watchers(declared.key, alive=False)

    def _tell_watchers(self, key: str, *, alive: bool) -> None:
        for declared in tuple(self._network.watchers):
            if matches(declared.key, key):
                declared.bus._call(declared.callback, key, alive)

    def _call(self, callback: object, *arguments: object) -> None:
        assert callable(callback)
        try:
            callback(*arguments)
        except Exception:
            self._callback_errors += 1
            logger.exception("A callback failed on %s; the stream continues.", arguments[0])

    def _reply(self, handler: object, query: Query, max_bytes: int) -> Answers:
        assert callable(handler)
        try:
            given = (
                Sample(key, bytes(payload), self._clock.now_ns(), False)
                for key, payload in handler(query)
            )
            return Answers.first_of(given, max_bytes)
        except Exception as error:
            self._callback_errors += 1
            logger.exception("A query on %s could not be answered.", query.key)
            return Answers(errors=[f"{type(error).__name__}: {error}"])


def _gather(questions: list[Callable[[], Answers]], timeout_s: float) -> Answers:
    """Send the queries at once, each in a thread, and wait for all up to `timeout_s`."""
    replies: list[Answers] = []
    threads = [
        threading.Thread(target=lambda q=question: replies.append(q()), daemon=True)
        for question in questions
    ]
    for thread in threads:
        thread.start()
    deadline = time.monotonic() + timeout_s
    for thread in threads:
        thread.join(max(0.0, deadline - time.monotonic()))
    done = list(replies)
    late = ["Timeout"] * (len(questions) - len(done))
    return Answers(
        (sample for reply in done for sample in reply),
        [*(text for reply in done for text in reply.errors), *late],
    )

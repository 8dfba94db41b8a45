"""A bus that connects in the background while its process already works."""

import logging
import math
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Self

from .protocol import (
    MOST_ANSWER_BYTES,
    Answers,
    Bus,
    BusClosedError,
    BusUnreachableError,
    Handle,
    Query,
    Sample,
)

logger = logging.getLogger(__name__)

RETRY_PAUSE_S = 0.5
"""Pause between two attempts to connect [s]."""


class _Promised:
    """Something that is declared once there is a bus to declare it on."""

    def __init__(self, bus: "BackgroundBus", declare: Callable[[Bus], Handle]) -> None:
        self._bus, self._declare = bus, declare
        self._handle: Handle | None = None
        self._closed = False

    def keep(self, bus: Bus) -> None:
        """Declare it; the caller holds the lock."""
        if not self._closed:
            self._handle = self._declare(bus)

    def close(self) -> None:
        """Undeclare it, or never declare it."""
        self._bus._withdraw(self)
        self._closed = True
        if self._handle is not None:
            self._handle.close()


class BackgroundBus:
    """A bus that waits for its router without limit, and logs that at intervals.

    Until then nobody is heard, nothing that is published reaches anybody, and questions have no
    answers: as on a bus whose router has gone away.

    Parameters
    ----------
    opened
        Opens the bus, or raises `BusUnreachableError`; is called again and again.
    say_every_s
        How often it is said that it waits, after the first time [s].
    """

    def __init__(self, opened: Callable[[], Bus], *, say_every_s: float = 30.0) -> None:
        self._open, self._say_every_s = opened, say_every_s
        self._bus: Bus | None = None
        self._promised: list[_Promised] = []
        self._lock = threading.RLock()
        self._over, self._opened = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._try, name="bus", daemon=True)
        self._thread.start()

    def wait(self, timeout_s: float) -> bool:
        """Wait a while for the bus; whether it is open."""
        return self._opened.wait(timeout_s)

    @property
    def connected(self) -> bool:
        """Whether the bus is open, and connected."""
        return self._bus is not None and bool(getattr(self._bus, "connected", True))

    @property
    def callback_errors(self) -> int:
        """Number of exceptions raised by callbacks and handlers."""
        return 0 if self._bus is None else self._bus.callback_errors

    @property
    def watch_delay_s(self) -> float:
        """Time that `watch` may take; before there is a bus, it reports no process."""
        return math.inf if self._bus is None else self._bus.watch_delay_s

    def publish(
        self, key: str, payload: bytes, *, encoding: str, replayed: bool = False
    ) -> None:
        """Send; before there is a bus, the message is dropped."""
        self._check_open()
        if self._bus is not None:
            self._bus.publish(key, payload, encoding=encoding, replayed=replayed)

    def subscribe(self, key_expression: str, callback: Callable[[Sample], None]) -> Handle:
        """Call `callback` for each message, once there is a bus."""
        return self._promise(lambda bus: bus.subscribe(key_expression, callback))

    def answer(
        self, key: str, handler: Callable[[Query], Iterable[tuple[str, bytes]]]
    ) -> Handle:
        """Answer questions, once there is a bus."""
        return self._promise(lambda bus: bus.answer(key, handler))

    def ask(
        self,
        key_expression: str,
        parameters: Mapping[str, str] | None = None,
        *,
        timeout_s: float = 2.0,
        max_bytes: int = MOST_ANSWER_BYTES,
    ) -> Answers:
        """All answers; none before there is a bus."""
        self._check_open()
        if self._bus is None:
            return Answers()
        return self._bus.ask(
            key_expression, parameters, timeout_s=timeout_s, max_bytes=max_bytes
        )

    def announce(self, key: str) -> Handle:
        """Be alive under `key`, once there is a bus."""
        return self._promise(lambda bus: bus.announce(key))

    def watch(self, key_expression: str, callback: Callable[[str, bool], None]) -> Handle:
        """Call `callback` for each process that is alive, once there is a bus."""
        return self._promise(lambda bus: bus.watch(key_expression, callback))

    def close(self) -> None:
        """Try no more, and leave."""
        self._over.set()
        self._thread.join()
        with self._lock:
            self._promised.clear()
            if self._bus is not None:
                self._bus.close()

    def __enter__(self) -> Self:
        """Return the bus."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()

    def _try(self) -> None:
        """Open the bus, sooner or later."""
        began_s, said_s = time.monotonic(), -math.inf
        while not self._over.is_set():
            try:
                bus = self._open()
            except BusUnreachableError as error:
                now_s = time.monotonic()
                if now_s - said_s >= self._say_every_s:
                    said_s = now_s
                    logger.warning(
                        "No bus yet, after %.0f s; still trying. %s", now_s - began_s, error
                    )
                self._over.wait(RETRY_PAUSE_S)
                continue
            with self._lock:
                self._bus = bus
                for promised in self._promised:
                    promised.keep(bus)
                self._promised.clear()
            self._opened.set()
            if said_s > began_s:
                logger.info("The bus is open, after %.1f s.", time.monotonic() - began_s)
            return

    def _promise(self, declare: Callable[[Bus], Handle]) -> Handle:
        self._check_open()
        with self._lock:
            if self._bus is not None:
                return declare(self._bus)
            promised = _Promised(self, declare)
            self._promised.append(promised)
            return promised

    def _withdraw(self, promised: _Promised) -> None:
        with self._lock:
            if promised in self._promised:
                self._promised.remove(promised)

    def _check_open(self) -> None:
        if self._over.is_set():
            raise BusClosedError

"""Bounds the time for which the answer of a database server is waited for.

A server that is stopped, or cut off by a firewall, leaves its connections open and answers none
of them. Limits that the server keeps, such as PostgreSQL's `statement_timeout`, do not help.
"""

import contextlib
import itertools
import math
import os
import socket
import threading
import time
from collections.abc import Iterator

from .errors import StoreError

LOOK_S = 0.5
"""How often is looked whether an answer is overdue [s]; small beside the time it may take."""

AWAY_S = 2.0
"""How long nothing is asked of a database that did not answer [s], so that callers are told at
once instead of each waiting as long as the first."""


class Away:
    """Remembers for a while that a database did not answer."""

    def __init__(self) -> None:
        self._until_s, self._text = 0.0, ""

    def note(self, text: str) -> None:
        """Remember why nothing is asked for a while."""
        self._until_s, self._text = time.monotonic() + AWAY_S, text

    def clear(self) -> None:
        """Forget it: the database answers."""
        self._until_s = 0.0

    def check(self) -> None:
        """Raise while nothing is asked.

        Raises
        ------
        StoreError
            Which says what happened before.
        """
        if time.monotonic() < self._until_s:
            raise StoreError(self._text)


class ConnectionDeadlines:
    """Ends connections whose server does not answer in good time.

    Parameters
    ----------
    away
        Told of each.
    name
        Of the database.
    """

    def __init__(self, away: Away, name: str) -> None:
        self._away, self._name = away, name
        self._lock = threading.Lock()
        self._due: dict[int, tuple[float, int]] = {}
        self._numbers = itertools.count()
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None

    @contextlib.contextmanager
    def within(self, seconds: float, descriptor: int) -> Iterator[None]:
        """Shut the socket of a connection where the block takes longer.

        Whoever waits for the socket is told that the server has closed the connection.
        """
        if math.isinf(seconds):
            yield
            return
        number = next(self._numbers)
        with self._lock:
            self._due[number] = time.monotonic() + seconds, descriptor
            if self._thread is None:
                self._thread = threading.Thread(
                    target=self._watch, name="deadlines", daemon=True
                )
                self._thread.start()
        try:
            yield
        finally:
            with self._lock:
                self._due.pop(number, None)

    def close(self) -> None:
        """Watch no longer."""
        self._closed.set()
        if self._thread is not None:
            self._thread.join()

    def _watch(self) -> None:
        while not self._closed.wait(LOOK_S):
            now_s = time.monotonic()
            # The lock keeps descriptors from being closed, and used for others, meanwhile.
            with self._lock:
                overdue = [n for n, (due_s, _) in self._due.items() if due_s <= now_s]
                for number in overdue:
                    self._away.note(
                        f"{self._name} has not answered a statement in good time. Look whether "
                        "its server runs, and at the network."
                    )
                    _shut(self._due.pop(number)[1])


def _shut(descriptor: int) -> None:
    with contextlib.suppress(OSError), socket.socket(fileno=os.dup(descriptor)) as connection:
        connection.shutdown(socket.SHUT_RDWR)

"""Closes connections at their deadline, by one thread for all."""

import contextlib
import heapq
import itertools
import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple


class _Entry(NamedTuple):
    at_s: float
    number: int
    connected: Callable[[], socket.socket | None]


class Deadlines:
    """A thread that sleeps until the next deadline, and ends once there has been none for long.

    A time limit of each operation on a socket is not enough: a peer that answers byte by byte
    keeps within it for ever.
    """

    def __init__(self, idle_s: float = 60.0) -> None:
        self._idle_s = idle_s
        self._changed = threading.Condition()
        self._entries: list[_Entry] = []
        self._open: set[int] = set()
        self._numbers = itertools.count()
        self._running = False

    @contextlib.contextmanager
    def within(
        self, seconds: float, connected: Callable[[], socket.socket | None]
    ) -> Iterator[None]:
        """Shut the socket that `connected` gives by then, unless the block has ended.

        Parameters
        ----------
        seconds
            Time until the socket is shut [s].
        connected
            Returns the socket, or None before there is one.
        """
        entry = _Entry(time.monotonic() + seconds, next(self._numbers), connected)
        with self._changed:
            self._open.add(entry.number)
            heapq.heappush(self._entries, entry)
            if not self._running:
                self._running = True
                threading.Thread(target=self._run, name="notify-deadlines", daemon=True).start()
            elif self._entries[0] is entry:
                self._changed.notify()
        try:
            yield
        finally:
            with self._changed:
                self._open.discard(entry.number)

    def _run(self) -> None:
        while True:
            with self._changed:
                while self._entries and self._entries[0].number not in self._open:
                    heapq.heappop(self._entries)
                if not self._entries:
                    if not self._changed.wait(self._idle_s) and not self._entries:
                        self._running = False
                        return
                    continue
                left_s = self._entries[0].at_s - time.monotonic()
                if left_s > 0.0:
                    self._changed.wait(left_s)
                    continue
                entry = heapq.heappop(self._entries)
            with contextlib.suppress(OSError):
                if (sock := entry.connected()) is not None:
                    sock.shutdown(socket.SHUT_RDWR)


DEADLINES = Deadlines()
"""Of this process."""

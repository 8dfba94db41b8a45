"""Time spent on compiling machine code."""

import threading
import time

from numba.core.event import Event, Listener, register


class _Spent(Listener, threading.local):  # type: ignore[misc]
    """Processor time of each thread, from when it first compiles to when it has done so."""

    def __init__(self) -> None:
        super().__init__()
        self.seconds, self._since, self._depth = 0.0, 0.0, 0

    def on_start(self, event: Event) -> None:
        if self._depth == 0:
            self._since = time.thread_time()
        self._depth += 1

    def on_end(self, event: Event) -> None:
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.thread_time() - self._since


_SPENT = _Spent()
register("numba:compiler_lock", _SPENT)


def compiling_s() -> float:
    """Processor time that this thread has spent on making machine code so far [s]."""
    return _SPENT.seconds

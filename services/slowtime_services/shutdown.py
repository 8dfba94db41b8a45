"""Shutdown of a process: Ctrl-C and SIGTERM set an event."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def ended_by_signals(stop: threading.Event | None = None) -> Iterator[threading.Event]:
    """Set `stop` on SIGINT and SIGTERM; restore the former handlers afterwards.

    In a thread other than the main one, which signals do not reach, nothing else is done.
    """
    stop = stop or threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return

    def end(_number: int, _frame: FrameType | None) -> None:
        stop.set()

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)

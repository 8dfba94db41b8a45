"""Shutdown of a process: Ctrl-C and SIGTERM set an event; what outlasts it is ended."""

import contextlib
import faulthandler
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

GRACE_S = 20.0
"""How long a process may take to end after a signal [s]; then its stacks are written, and it is
ended. An idle machine needs a second or two; containers are waited for 30 s."""


@contextmanager
def ended_by_signals(
    stop: threading.Event | None = None, *, grace_s: float = GRACE_S
) -> Iterator[threading.Event]:
    """Set `stop` on SIGINT and SIGTERM; restore the former handlers afterwards.

    In a thread other than the main one, which signals do not reach, nothing else is done.

    Parameters
    ----------
    stop
        Event to set; one of its own by default.
    grace_s
        How long all within may take to end after a signal, until the process is ended [s].
    """
    stop = stop or threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return

    def end(_number: int, _frame: FrameType | None) -> None:
        if not stop.is_set():
            end_later(grace_s)
        stop.set()

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        faulthandler.cancel_dump_traceback_later()
        for number, handler in before.items():
            signal.signal(number, handler)


def end_later(grace_s: float) -> None:
    """End this process after a while, whatever its threads do then.

    The timer is a thread of the C library, so that it needs no lock of the interpreter.
    """
    if sys.__stderr__ is not None:
        with contextlib.suppress(OSError, ValueError):  # it is no file
            faulthandler.dump_traceback_later(grace_s, exit=True, file=sys.__stderr__)

"""The router, made of the Zenoh binding itself: what edges, twin and recorder connect to."""

import logging
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import FrameType

from slowtime_services.bus import BusUnreachableError, ZenohBus

logger = logging.getLogger(__name__)

DEFAULT_LISTEN = ("tcp/0.0.0.0:7447",)


def run(
    listen: Sequence[str] = DEFAULT_LISTEN,
    connect: Sequence[str] = (),
    *,
    stop: threading.Event | None = None,
    options: Mapping[str, object] | None = None,
    ready: Callable[[Sequence[str]], None] | None = None,
) -> None:
    """Route until `stop` is set, or until SIGINT or SIGTERM.

    Parameters
    ----------
    listen
        Endpoints to listen on.
    connect
        Other routers to join.
    stop
        Set from outside to end.
    options
        Further Zenoh settings, such as those of TLS or access control.
    ready
        Told the endpoints once they listen.

    Raises
    ------
    BusUnreachableError
        If an endpoint is taken or misspelt.
    """
    stop = stop or threading.Event()
    with _ended_by_signals(stop), ZenohBus("router", connect, listen, options=options):
        logger.info("Router listens on %s.", ", ".join(listen))
        if ready is not None:
            ready(listen)
        stop.wait()
    logger.info("Router has ended.")


def check(endpoint: str, *, timeout_s: float = 2.0) -> bool:
    """Whether a router answers at `endpoint`: a session opens and sees one.

    Made for a container's health check; it takes at most about `timeout_s`.
    """
    try:
        with ZenohBus("client", connect=[endpoint], open_timeout_s=timeout_s) as bus:
            return bus.connected
    except BusUnreachableError:
        return False


@contextmanager
def _ended_by_signals(stop: threading.Event) -> Iterator[None]:
    """Let SIGINT and SIGTERM set `stop`, where this is the thread that signals reach."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(_number: int, _frame: FrameType | None) -> None:
        stop.set()

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)

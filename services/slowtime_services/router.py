"""The router, made of the Zenoh binding itself: what edges, twin and recorder connect to."""

import logging
import threading
from collections.abc import Callable, Mapping, Sequence

from slowtime_services.bus import BusUnreachableError, ZenohBus
from slowtime_services.ending import ended_by_signals

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
    with (
        ended_by_signals(stop) as end,
        ZenohBus("router", connect, listen, options=options),
    ):
        logger.info("Router listens on %s.", ", ".join(listen))
        if ready is not None:
            ready(listen)
        end.wait()
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

"""Connection to the router: retried until it answers or Ctrl-C is pressed."""

import contextlib
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from slowtime_services.bus import BusUnreachableError, ZenohBus
from slowtime_services.credentials import options_for

from .options import endpoints
from .terminal import StopFlag

TIMEOUT_S = 10.0
"""Time that the router is waited for [s]."""
ATTEMPT_S = 2.0
"""Time of one attempt to connect [s]: Ctrl-C is not heard while Zenoh opens a session."""


@contextlib.contextmanager
def connected(
    connect: Sequence[str],
    stop: StopFlag,
    credentials: Path | None = None,
    *,
    patience_s: float = TIMEOUT_S,
) -> Iterator[ZenohBus]:
    """Yield a client's bus.

    Raises
    ------
    CredentialsError
        If the credentials are of no use.
    BusUnreachableError
        Where no router answers within `patience_s`, or before `stop` is set otherwise.
    KeyboardInterrupt
        Where Ctrl-C is heard before one does.
    """
    connect = endpoints(connect, credentials)
    options = options_for(credentials, connect)
    deadline = time.monotonic() + patience_s
    while True:
        began = time.monotonic()
        try:
            bus = ZenohBus(
                "client", connect, open_timeout_s=min(ATTEMPT_S, patience_s), options=options
            )
        except BusUnreachableError:
            ended = stop.wait(max(0.0, 0.2 - (time.monotonic() - began)))
            if stop.interrupted:
                raise KeyboardInterrupt from None
            if ended or time.monotonic() >= deadline:
                raise
        else:
            break
    with bus:
        yield bus

"""Standard input: the output of another program."""

import os
import select
import sys
import threading
from collections.abc import Iterator

from edge_agent.acquire.live.batch import Packet
from edge_agent.acquire.live.registry import Opened, TransportContext, declared
from edge_agent.inputs import LiveInput
from slowtime_services.clock import Clock

from .limits import AT_ONCE, POLL_S


class StandardInput:
    """A file descriptor, read as bytes come."""

    is_stream = ends = True

    def __init__(self, clock: Clock, descriptor: int | None = None) -> None:
        self._clock = clock
        self._descriptor = sys.stdin.fileno() if descriptor is None else descriptor

    def packets(self, stop: threading.Event) -> Iterator[Packet | None]:
        """Bytes, until the other program ends."""
        while not stop.is_set():
            ready, _, _ = select.select([self._descriptor], [], [], POLL_S)
            if not ready:
                yield None
                continue
            data = os.read(self._descriptor, AT_ONCE)
            if not data:
                return
            yield Packet(data, self._clock.now_ns())

    def close(self) -> None:
        """Do nothing: each connection closes its own resources."""


def opened(settings: LiveInput, around: TransportContext) -> Opened:
    """Read standard input."""
    return Opened(StandardInput(around.clock), *declared(settings, "stdin"))

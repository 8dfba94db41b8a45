"""UDP: each datagram is a message."""

import socket
import threading
from collections.abc import Iterator

from edge_agent.acquire.live.batch import Packet
from edge_agent.acquire.live.registry import Opened, TransportContext, declared
from edge_agent.inputs import LiveInput
from slowtime_services.clock import Clock

from .limits import POLL_S
from .tcp import Address, address_of

LARGEST = 65_535
"""Bytes of the largest datagram of UDP over IPv4, header included."""

KERNEL_BYTES = 4 * 2**20
"""Of the socket's buffer: what comes while this process waits for a processor."""


class Datagrams:
    """A bound socket."""

    is_stream = ends = False

    def __init__(self, address: Address, clock: Clock) -> None:
        self._clock = clock
        family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, KERNEL_BYTES)
        self._socket.bind(address)
        self._socket.settimeout(POLL_S)

    @property
    def port(self) -> int:
        """The port that is listened on."""
        port: int = self._socket.getsockname()[1]
        return port

    def packets(self, stop: threading.Event) -> Iterator[Packet | None]:
        """Datagrams as they come."""
        while not stop.is_set():
            try:
                data = self._socket.recv(LARGEST)
            except TimeoutError:
                yield None
                continue
            yield Packet(data, self._clock.now_ns())

    def close(self) -> None:
        """Listen no more."""
        self._socket.close()


def opened(settings: LiveInput, around: TransportContext) -> Opened:
    """Bind the port."""
    layout, rate_hz = declared(settings, settings.scheme)
    return Opened(Datagrams(address_of(settings.source), around.clock), layout, rate_hz)

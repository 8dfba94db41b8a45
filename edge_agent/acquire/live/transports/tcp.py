"""TCP, as client or as server of one device at a time."""

import socket
import threading
from collections.abc import Iterator
from urllib.parse import urlsplit

from edge_agent.acquire.live.batch import Packet
from edge_agent.acquire.live.registry import Opened, TransportContext, declared
from edge_agent.inputs import LiveInput
from slowtime_services.clock import Clock

from .limits import AT_ONCE, POLL_S

Address = tuple[str, int]


def address_of(source: str) -> Address:
    """Host and port of a URL.

    Raises `ValueError` where one is missing.
    """
    parts = urlsplit(source)
    if not parts.hostname or parts.port is None:
        raise ValueError(f"{source!r} has no host and port. Give {parts.scheme}://HOST:PORT.")
    return parts.hostname, parts.port


class TcpClient:
    """Connects to a device, and reconnects when the connection is lost."""

    is_stream, ends = True, False

    def __init__(self, address: Address, clock: Clock, timeout_s: float = 5.0) -> None:
        self._address, self._clock, self._timeout_s = address, clock, timeout_s

    def packets(self, stop: threading.Event) -> Iterator[Packet | None]:
        """Bytes of one connection."""
        with socket.create_connection(self._address, self._timeout_s) as connection:
            yield from received(connection, self._clock, stop)

    def close(self) -> None:
        """Do nothing: each connection closes its own resources."""


class TcpServer:
    """Listens; a device that connects replaces the one before."""

    is_stream, ends = True, False

    def __init__(self, address: Address, clock: Clock) -> None:
        self._clock = clock
        family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        self._listener = socket.create_server(address, family=family, backlog=1)
        self._listener.settimeout(POLL_S)

    @property
    def port(self) -> int:
        """The port that is listened on."""
        port: int = self._listener.getsockname()[1]
        return port

    def packets(self, stop: threading.Event) -> Iterator[Packet | None]:
        """Bytes of the next device that connects."""
        while not stop.is_set():
            try:
                connection, _ = self._listener.accept()
            except TimeoutError:
                yield None
                continue
            with connection:
                yield from received(connection, self._clock, stop)
                return

    def close(self) -> None:
        """Listen no more."""
        self._listener.close()


def received(
    connection: socket.socket, clock: Clock, stop: threading.Event
) -> Iterator[Packet | None]:
    """Bytes as they come, until the other side ends."""
    connection.settimeout(POLL_S)
    # A device that loses power says no goodbye: the system then asks whether it is there.
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    while not stop.is_set():
        try:
            data = connection.recv(AT_ONCE)
        except TimeoutError:
            yield None
            continue
        if not data:
            return
        yield Packet(data, clock.now_ns())


def opened(settings: LiveInput, around: TransportContext) -> Opened:
    """Connect, or listen, by the scheme."""
    layout, rate_hz = declared(settings, settings.scheme)
    address = address_of(settings.source)
    if settings.scheme == "tcp-listen":
        return Opened(TcpServer(address, around.clock), layout, rate_hz)
    timeout_s = float(settings.parameters.get("timeout_s", "5"))
    return Opened(TcpClient(address, around.clock, timeout_s), layout, rate_hz)

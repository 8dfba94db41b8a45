"""A serial port, by pyserial."""

import threading
from collections.abc import Iterator
from urllib.parse import unquote, urlsplit

import serial

from edge_agent.acquire.live.batch import Packet
from edge_agent.acquire.live.registry import Opened, TransportContext, declared
from edge_agent.inputs import LiveInput
from slowtime_services.clock import Clock

from .limits import AT_ONCE, POLL_S


class SerialPort:
    """A port that is opened again where the plug was pulled."""

    is_stream, ends = True, False

    def __init__(self, device: str, baud: int, clock: Clock) -> None:
        self._device, self._baud, self._clock = device, baud, clock

    def packets(self, stop: threading.Event) -> Iterator[Packet | None]:
        """Bytes of the port, as long as it is there."""
        with serial.Serial(self._device, self._baud, timeout=POLL_S) as port:
            while not stop.is_set():
                data = port.read(1)
                now_ns = self._clock.now_ns()
                if not data:
                    yield None
                    continue
                waiting = min(port.in_waiting, AT_ONCE)
                yield Packet(data + (port.read(waiting) if waiting else b""), now_ns)

    def close(self) -> None:
        """Do nothing: each connection closes its own resources."""


def opened(settings: LiveInput, around: TransportContext) -> Opened:
    """Open the port that the URL names."""
    device = unquote(urlsplit(settings.source).path)
    if not device:
        raise ValueError(
            f"{settings.source!r} names no port. Give one, such as serial:///dev/ttyUSB0."
        )
    words = settings.parameters.get("baud", "115200")
    if not words.isdigit():
        raise ValueError(
            f"baud={words!r} is not a valid rate. Give bits per second, such as 115200."
        )
    layout, rate_hz = declared(settings, settings.scheme)
    return Opened(SerialPort(device, int(words), around.clock), layout, rate_hz)

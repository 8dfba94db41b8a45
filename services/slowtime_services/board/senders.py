"""Senders of readings by MQTT, TCP, UDP, serial line, Zenoh or standard output."""

import json
import socket
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol
from urllib.parse import urlsplit

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import SensorSamples
from slowtime_schemas.streams import SAMPLES
from slowtime_services.bus import ZenohBus

from .motion import COUNT_M_PER_S2, Burst

DESTINATIONS: Mapping[str, str] = {
    "mqtt": "mqtt://HOST:PORT/TOPIC, a JSON message",
    "tcp": "tcp://HOST:PORT, lines of text to who listens there",
    "udp": "udp://HOST:PORT, a datagram of lines of text",
    "serial": "serial:///dev/NAME, lines of text",
    "zenoh": "zenoh:SITE/ASSET, a `samples` message by the router",
    "-": "standard output, lines of text",
}
"""Schemes of destinations, and what is sent there."""


class ReadingSender(Protocol):
    """Takes readings to where they go."""

    def send(self, readings: Burst) -> None:
        """Send blocks; OSError if no receiver accepts them."""
        ...

    def close(self) -> None:
        """Send nothing more."""
        ...


def lines_of(readings: Burst) -> bytes:
    """One line a sample: counter, then the axes."""
    return b"".join(
        b"%d,%d,%d,%d\n" % (readings.counter + n, *row)
        for n, row in enumerate(readings.counts.tolist())
    )


def json_of(readings: Burst) -> bytes:
    """One object: the counter of the first sample, and an array an axis."""
    x, y, z = readings.counts.T.tolist()
    return json.dumps({"n": readings.counter, "x": x, "y": y, "z": z}).encode()


class _Lines:
    def __init__(self, write: Callable[[bytes], object], close: Callable[[], object]) -> None:
        self._write, self._close = write, close

    def send(self, readings: Burst) -> None:
        self._write(lines_of(readings))

    def close(self) -> None:
        self._close()


class _Mqtt:
    def __init__(self, host: str, port: int, topic: str) -> None:
        try:
            from paho.mqtt import client as paho
            from paho.mqtt.enums import CallbackAPIVersion
        except ModuleNotFoundError as error:
            raise ValueError(
                "mqtt: needs paho-mqtt, which is not installed. Install it: "
                "pip install 'slowtime[mqtt]'."
            ) from error
        self._topic = topic
        self._client = paho.Client(CallbackAPIVersion.VERSION2)
        self._client.connect(host, port)
        self._client.loop_start()

    def send(self, readings: Burst) -> None:
        self._client.publish(self._topic, json_of(readings), qos=1)

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()


class _Zenoh:
    def __init__(self, site: str, asset: str, rate_hz: float, router: str) -> None:
        self._bus = ZenohBus("client", (router,))
        self._site, self._asset, self._rate_hz, self._sequence = site, asset, rate_hz, 0

    def send(self, readings: Burst) -> None:
        message = SensorSamples(
            site=self._site,
            asset=self._asset,
            boot="board",
            sequence=self._sequence,
            t_ns=time.time_ns(),
            rate_hz=self._rate_hz,
            first_index=readings.counter,
            channels=("x", "y", "z"),
            units=("m/s^2",) * 3,
            samples=tuple(map(tuple, (readings.counts * COUNT_M_PER_S2).tolist())),
        )
        self._sequence += 1
        key = SAMPLES.key(self._site, self._asset)
        self._bus.publish(key, encode(message), encoding=SAMPLES.encoding)

    def close(self) -> None:
        self._bus.close()


def sender_to(url: str, rate_hz: float, router: str) -> ReadingSender:
    """Open a destination.

    Raises
    ------
    ValueError
        Where it is none of `DESTINATIONS`.
    """
    if url == "-":
        out = sys.stdout.buffer
        return _Lines(lambda data: (out.write(data), out.flush()), lambda: None)
    parts = urlsplit(url)
    host, port, path = parts.hostname or "", parts.port, parts.path
    if parts.scheme == "mqtt" and host and path.strip("/"):
        return _Mqtt(host, port or 1883, path.strip("/"))
    if parts.scheme == "tcp" and host and port:
        connection = socket.create_connection((host, port), 10.0)
        return _Lines(connection.sendall, connection.close)
    if parts.scheme == "udp" and host and port:
        datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        datagrams.connect((host, port))
        return _Lines(datagrams.send, datagrams.close)
    if parts.scheme == "serial" and path:
        device = Path(path).open("wb", buffering=0)
        return _Lines(device.write, device.close)
    site, _, asset = path.partition("/")
    if parts.scheme == "zenoh" and site and asset:
        return _Zenoh(site, asset, rate_hz, router)
    raise ValueError(
        f"{url!r:.200} is not a valid destination. Allowed: {'; '.join(DESTINATIONS.values())}."
    )

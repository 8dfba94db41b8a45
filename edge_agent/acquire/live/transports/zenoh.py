"""Samples that another program publishes on the bus of slowtime."""

import logging
import threading
from collections.abc import Iterator
from urllib.parse import unquote

import numpy as np

from edge_agent.acquire.live.batch import Batch, GarbledError, Packet
from edge_agent.acquire.live.formats.decoding import AnyLayout
from edge_agent.acquire.live.registry import Opened, TransportContext, declared
from edge_agent.inputs import LiveInput
from edge_agent.layouts import Channel, CounterField, JsonLayout
from slowtime_schemas.codec import Refused, decode
from slowtime_schemas.messages import SensorSamples
from slowtime_schemas.streams import SAMPLES
from slowtime_services.bus import Bus, Inbox, Sample, TwoVersionBus
from slowtime_services.clock import Clock

from .limits import POLL_S

logger = logging.getLogger(__name__)

MOST_BYTES = 64 * 2**20
"""That wait between a thread of the bus and the reader."""


class BusSamples:
    """A subscription; a callback of the bus only enqueues."""

    is_stream = ends = False

    def __init__(self, bus: Bus, key: str, clock: Clock) -> None:
        self._bus, self._key, self._clock = bus, key, clock
        self._inbox: Inbox[Packet] = Inbox(max_bytes=MOST_BYTES)
        self._handle = bus.subscribe(key, self._hear)
        self._first: list[Packet] = []

    def packets(self, stop: threading.Event) -> Iterator[Packet | None]:
        """Messages as they come."""
        yield from self._first
        self._first = []
        while not stop.is_set():
            taken = self._inbox.take(timeout_s=POLL_S)
            yield from taken or (None,)

    def close(self) -> None:
        """Listen no more."""
        self._handle.close()

    def describe(self, stop: threading.Event) -> tuple[AnyLayout, float] | None:
        """Wait for the first `samples` message, and read channels, units and rate out of it."""
        while not stop.is_set():
            for packet in self._inbox.take(limit=1, timeout_s=POLL_S):
                try:
                    told = read_samples(packet.data)
                    channels = tuple(
                        Channel(name=name, unit=unit)
                        for name, unit in zip(told.channels, told.units, strict=True)
                    )
                    layout = JsonLayout(
                        channels=channels, counter=CounterField(at="first_index")
                    )
                except ValueError as error:  # `GarbledError` is one
                    logger.debug("A message that describes no samples: %s", error)
                    continue
                self._first = [packet]
                return layout, told.rate_hz
        return None

    def _hear(self, sample: Sample) -> None:
        self._inbox.put(Packet(sample.payload, self._clock.now_ns()), len(sample.payload))


def read_samples(payload: bytes) -> SensorSamples:
    """Read a `samples` message.

    Raises `GarbledError` where it is none.
    """
    try:
        told = decode(SAMPLES, payload)
    except Refused as refused:
        raise GarbledError(str(refused)) from refused
    assert isinstance(told, SensorSamples)
    return told


class _Decoder:
    """Decodes messages with the channels of the first one."""

    def __init__(self) -> None:
        self._channels: tuple[str, ...] | None = None

    def __call__(self, data: bytes, arrival_ns: int) -> list[Batch]:
        told = read_samples(data)
        if self._channels is None:
            self._channels = told.channels
        if told.channels != self._channels:
            raise GarbledError(
                f"Channels {told.channels} were given in a stream of {self._channels}."
            )
        rows = np.array(told.samples, dtype=np.float64)
        return [Batch(rows, arrival_ns, told.first_index)]


def opened(settings: LiveInput, around: TransportContext) -> Opened:
    """Subscribe to a key, or to the samples of this asset."""
    if around.bus is None:
        raise ValueError("zenoh: needs the bus of an edge agent.")
    key = unquote(settings.bare.partition(":")[2].lstrip("/"))
    transport = BusSamples(
        TwoVersionBus(around.bus), key or SAMPLES.key(*around.twin), around.clock
    )
    if settings.layout is not None:
        return Opened(transport, *declared(settings, "zenoh"))
    return Opened(transport, None, None, _Decoder())

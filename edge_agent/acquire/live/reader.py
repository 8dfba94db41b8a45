"""Reads packets in a thread, and puts their batches into a bounded queue."""

import logging
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Protocol, runtime_checkable

from slowtime_services.bus import Inbox

from .batch import Batch, GarbledError, Packet
from .counts import SampleCounts
from .formats.decoding import AnyLayout, Decoder
from .formats.framing import Framer

logger = logging.getLogger(__name__)

BACKOFF_S = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
"""From one attempt to connect to the next; the last is repeated."""

WIDE = 64
"""Channels beyond which a sample takes the place of several in the queue [1], whose length is
set in samples: the first message of a program says how many channels there are."""


@runtime_checkable
class Transport(Protocol):
    """A source of packets."""

    is_stream: bool
    """Whether packets are pieces of a stream, with borders to be found in it."""
    ends: bool
    """Whether its end is the end of the source, and not a lost connection."""

    def packets(self, stop: threading.Event) -> Iterator[Packet | None]:
        """Connect, and give packets as they come; None now and then where nothing does.

        It returns where the other side has ended, and raises OSError where the connection
        fails; either way it is called again, later.
        """
        ...

    def close(self) -> None:
        """Release the resources; the transport is not used afterwards."""
        ...


@runtime_checkable
class DescribingTransport(Protocol):
    """A transport whose first message describes the others."""

    def describe(self, stop: threading.Event) -> tuple[AnyLayout, float] | None:
        """Wait for layout and nominal rate [Hz]; None where stopped before."""
        ...


@runtime_checkable
class RestartingTransport(Protocol):
    """A transport that runs a plug-in, and restarts it when it ends."""

    pauses_s: Sequence[float]
    """Before each start that follows another; the last is repeated."""
    sound_s: float
    """A run that has lasted so long was sound: pauses are counted from the first again."""


class TransportReader:
    """Reads a transport in a thread of its own.

    Parameters
    ----------
    decoders
        By topic; that of "" for all topics that have none of their own.
    framer
        Finds messages in a stream; None where packets are messages.
    """

    def __init__(
        self,
        transport: Transport,
        decoders: Mapping[str, Decoder],
        framer: Framer | None,
        inbox: Inbox[Batch],
        tally: SampleCounts,
        stop: threading.Event,
    ) -> None:
        self._transport, self._decoders, self._framer = transport, decoders, framer
        self._inbox, self._tally, self._stop = inbox, tally, stop
        self._garbled = self._garbled_bytes = 0
        self._dropped = 0
        self._restarted = transport if isinstance(transport, RestartingTransport) else None
        self._thread = threading.Thread(target=self._run, name="sensor", daemon=True)

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def join(self) -> None:
        """Wait until it has noticed that it shall stop."""
        self._thread.join(5.0)

    def _run(self) -> None:
        attempts = 0
        while not self._stop.is_set():
            heard, began_s = False, time.monotonic()
            try:
                for packet in self._transport.packets(self._stop):
                    if self._stop.is_set():
                        break
                    if packet is not None:
                        heard = True
                        self._take(packet)
                if self._transport.ends:
                    break
                why = "the other side has ended it"
            except Exception as error:  # whatever a driver raises, the agent goes on
                why = f"{type(error).__name__}: {error}"
            if self._stop.is_set():
                break
            if self._restarted is not None:
                heard = heard and time.monotonic() - began_s >= self._restarted.sound_s
            attempts = 0 if heard else attempts
            self._lost_connection(why, attempts)
            attempts += 1
        self._transport.close()
        self._inbox.close()

    def _lost_connection(self, why: str, attempts: int) -> None:
        self._tally.add("sensor_reconnects")
        if self._framer is not None:
            self._framer.reset()
        pauses_s: Sequence[float] = BACKOFF_S
        if self._restarted is not None:
            self._tally.add("source_restarts")
            pauses_s = self._restarted.pauses_s
        pause_s = pauses_s[min(attempts, len(pauses_s) - 1)]
        if attempts & (attempts - 1) == 0:
            logger.warning("No connection to the sensor: %s. Trying again.", why)
        self._stop.wait(pause_s)

    def _take(self, packet: Packet) -> None:
        decode = self._decoders.get(packet.topic) or self._decoders.get("")
        if decode is None:
            self._refuse(packet.data, f"No channel has the topic {packet.topic!r:.80}.")
            return
        messages = [packet.data] if self._framer is None else self._framer.feed(packet.data)
        for message in messages:
            self._decode(decode, message, packet.arrival_ns)
        framed = 0 if self._framer is None else self._framer.garbage_bytes
        self._tally.put("garbage_bytes", self._garbled_bytes + framed)

    def _decode(self, decode: Decoder, message: bytes, arrival_ns: int) -> None:
        try:
            batches = decode(message, arrival_ns)
        except GarbledError as error:
            self._refuse(message, str(error))
            return
        for batch in batches:
            self._put(batch)

    def _put(self, batch: Batch) -> None:
        count = len(batch.rows)
        size = count * -(-len(batch.rows[0]) // WIDE)
        if self._inbox.put(batch._replace(dropped=self._dropped), size):
            self._dropped = 0
            return
        self._dropped += count
        self._tally.add("samples_dropped", count)

    def _refuse(self, data: bytes, why: str) -> None:
        self._garbled_bytes += len(data)
        self._garbled += 1
        framed = 0 if self._framer is None else self._framer.garbage_bytes
        self._tally.put("garbage_bytes", self._garbled_bytes + framed)
        if self._garbled & (self._garbled - 1) == 0:
            logger.warning(
                "A message of %d bytes is not what the layout declares (%d so far): %s It "
                "begins with %r.",
                len(data), self._garbled, why, data[:60],
            )  # fmt: skip

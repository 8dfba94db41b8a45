"""Topics of an MQTT broker, by paho-mqtt, whose network loop is run by the reader's thread."""

import collections
import secrets
import ssl
import threading
from collections.abc import Iterator, Sequence
from typing import Any
from urllib.parse import unquote

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode

from edge_agent.acquire.live.batch import Packet
from edge_agent.acquire.live.registry import Opened, TransportContext, declared
from edge_agent.inputs import LiveInput
from slowtime_services.clock import Clock

from .limits import POLL_S

CONNECT_S = 10.0
"""Time that the broker has for its answer to a connection [s]."""

KEEP_ALIVE_S = 15
"""Interval of the keep-alive of MQTT [s]."""

PORTS = {"mqtt": 1883, "mqtts": 8883}


class Mqtt:
    """Subscriptions at a broker.

    Where a client is named, the broker keeps its session: messages of QoS 1 wait there while
    the connection is lost; a nameless session would be left behind with each run.
    """

    is_stream = ends = False

    def __init__(
        self,
        address: tuple[str, int],
        topics: Sequence[str],
        clock: Clock,
        *,
        qos: int = 1,
        client_id: str = "",
        user: str | None = None,
        password: str | None = None,
        context: ssl.SSLContext | None = None,
        by_topic: bool = False,
    ) -> None:
        self._address, self._topics, self._clock, self._qos = address, topics, clock, qos
        self._by_topic = by_topic
        self._arrived: collections.deque[Packet] = collections.deque()
        self._refusal = ""
        self._is_subscribed = False
        self._client = paho.Client(
            CallbackAPIVersion.VERSION2,
            client_id=client_id or f"slowtime-{secrets.token_hex(6)}",
            clean_session=not client_id,
        )
        if user is not None:
            self._client.username_pw_set(user, password)
        if context is not None:
            self._client.tls_set_context(context)
        self._client.on_message = self._hear
        self._client.on_connect = self._subscribe
        self._client.on_subscribe = self._subscribed

    def packets(self, stop: threading.Event) -> Iterator[Packet | None]:
        """Messages of one connection."""
        self._refusal, self._is_subscribed = "", False
        began_ns = self._clock.elapsed_ns()
        try:
            self._client.connect(*self._address, keepalive=KEEP_ALIVE_S)
            while not stop.is_set():
                code = self._client.loop(POLL_S)
                while self._arrived:
                    yield self._arrived.popleft()
                if self._refusal:
                    raise ConnectionError(self._refusal)
                if code != MQTTErrorCode.MQTT_ERR_SUCCESS:
                    raise ConnectionError(paho.error_string(code))
                if (
                    not self._is_subscribed
                    and self._clock.elapsed_ns() - began_ns > CONNECT_S * 1e9
                ):
                    raise ConnectionError("The broker does not answer.")
                yield None
        finally:
            self._client.disconnect()

    def close(self) -> None:
        """Do nothing: each connection closes its own resources."""

    def _hear(self, client: paho.Client, data: Any, message: paho.MQTTMessage) -> None:
        if message.retain:
            return  # what a broker has kept from an unknown time before
        topic = message.topic if self._by_topic else ""
        self._arrived.append(Packet(bytes(message.payload), self._clock.now_ns(), topic))

    def _subscribe(
        self, client: paho.Client, data: Any, flags: Any, reason: Any, properties: Any
    ) -> None:
        if reason.is_failure:
            self._refusal = f"The broker refuses: {reason}."
            return
        client.subscribe([(topic, self._qos) for topic in self._topics])

    def _subscribed(
        self, client: paho.Client, data: Any, number: int, reasons: Any, properties: Any
    ) -> None:
        self._is_subscribed = True
        if any(reason.is_failure for reason in reasons):
            self._refusal = f"The broker refuses subscriptions to {', '.join(self._topics)}."


def tls_context(settings: LiveInput) -> ssl.SSLContext:
    """Check the broker's certificate, and show one's own where given."""
    context = ssl.create_default_context(
        cafile=None if settings.ca_file is None else str(settings.ca_file)
    )
    if settings.certificate_file is not None:
        key = None if settings.key_file is None else str(settings.key_file)
        context.load_cert_chain(str(settings.certificate_file), key)
    return context


def opened(settings: LiveInput, around: TransportContext) -> Opened:
    """Subscribe to the topic of the URL, or to those of the channels."""
    layout, rate_hz = declared(settings, settings.scheme)
    address, user, topic = parts_of(settings.source)
    topics = sorted({channel.topic for channel in layout.channels if channel.topic})
    if not topics and not topic:
        raise ValueError(
            f"{settings.source!r} names no topic. Give one, such as {settings.scheme}://HOST/"
            "bridge/accel, or a `topic` to each channel of the layout."
        )
    words = settings.parameters.get("qos", "1")
    if words not in ("0", "1", "2"):
        raise ValueError(f"qos={words!r}: allowed are 0, 1 and 2.")
    transport = Mqtt(
        address,
        topics or [topic],
        around.clock,
        qos=int(words),
        client_id=settings.parameters.get("client_id", ""),
        user=user,
        password=settings.password,
        context=tls_context(settings) if settings.scheme == "mqtts" else None,
        by_topic=bool(topics),
    )
    return Opened(transport, layout, rate_hz)


def parts_of(source: str) -> tuple[tuple[str, int], str | None, str]:
    """Address, user and topic of a URL; a topic may hold `#` and `+`.

    Examples
    --------
    >>> parts_of("mqtt://pi@10.0.0.2/bridge/+/accel/#")
    (('10.0.0.2', 1883), 'pi', 'bridge/+/accel/#')
    """
    scheme, _, rest = source.partition("?")[0].partition("://")
    place, _, topic = rest.partition("/")
    user, _, address = place.rpartition("@")
    host, _, port = address.rpartition(":") if not address.endswith("]") else (address, "", "")
    if not host:
        host, port = address, ""
    if not host or not (port or "0").isdigit():
        raise ValueError(f"{source!r} names no broker. Give {scheme}://HOST:PORT/TOPIC.")
    number = int(port) if port else PORTS.get(scheme, 1883)
    return (host.strip("[]"), number), unquote(user) or None, unquote(topic)

"""Publishes events by MQTT: one message each, with quality of service 1 or 2.

The driver, paho-mqtt, is an extra of the package and is imported only where a receiver asks.
"""

import re
import time
from collections.abc import Callable
from typing import Any

from slowtime_services.outbound.connections import connected
from twin_server.events.receivers import MqttReceiver

from .message import Message, NotDeliveredError, connection_error_text, credentials
from .webhook import tls

_STEP_S = 0.05
"""Time that the network loop waits at once [s]."""


class MqttSender:
    """Sends to one receiver, by one connection a message.

    Raises
    ------
    NotDeliveredError
        Where paho-mqtt is not installed.
    """

    def __init__(self, receiver: MqttReceiver) -> None:
        try:
            import paho.mqtt.client
            from paho.mqtt.packettypes import PacketTypes
            from paho.mqtt.properties import Properties
        except ImportError as error:
            raise NotDeliveredError(
                "A receiver by MQTT needs paho-mqtt. Install it: pip install 'slowtime[mqtt]'."
            ) from error
        self._receiver = receiver
        # Its types do not cover what is used of it.
        self._paho: Any = paho.mqtt.client
        properties: Any = Properties
        self._properties: Callable[[], Any] = lambda: properties(PacketTypes.PUBLISH)

    def check(self) -> None:
        """Raise where it cannot be sent to as things are."""
        credentials(self._receiver.credentials_file)
        if self._receiver.tls:
            tls(self._receiver.ca)

    def send(self, message: Message) -> str:
        """Send, and wait until the broker has acknowledged.

        Raises
        ------
        NotDeliveredError
            Where it has not in time.
        """
        until_s = time.monotonic() + self._receiver.timeout_s
        client, answered = self._client()
        try:
            client.connect(self._receiver.host, self._receiver.port, clean_start=True)
            self._wait(client, lambda: bool(answered), until_s)
            if answered[0].is_failure:
                raise NotDeliveredError(f"The broker refused: {answered[0].getName()}.")
            info = client.publish(
                self._topic(message), message.payload, qos=self._receiver.qos,
                properties=self._labels(message),
            )  # fmt: skip
            self._wait(client, info.is_published, until_s)
            client.disconnect()
        except (OSError, RuntimeError, ValueError) as error:
            raise NotDeliveredError(f"The broker: {connection_error_text(error)}.") from error
        finally:
            if (sock := client.socket()) is not None:
                sock.close()
        return ""

    def _client(self) -> tuple[Any, list[Any]]:
        """Make a client, and a list that receives the answer to its connection."""
        receiver = self._receiver
        answered: list[Any] = []
        client = self._paho.Client(
            self._paho.CallbackAPIVersion.VERSION2, protocol=self._paho.MQTTv5
        )
        client.connect_timeout = receiver.timeout_s
        # paho-mqtt connects by the name, which may lead elsewhere from one look-up to the next.
        client._create_socket_connection = lambda: connected(
            receiver.host, receiver.port, receiver.timeout_s, local=receiver.local
        )
        client.on_connect = lambda _c, _u, _f, reason, _p: answered.append(reason)
        if (known := credentials(receiver.credentials_file)) is not None:
            client.username_pw_set(*known)
        if receiver.tls:
            client.tls_set_context(tls(receiver.ca))
        return client, answered

    def _wait(self, client: Any, holds: Any, until_s: float) -> None:
        while not holds():
            if time.monotonic() > until_s:
                raise TimeoutError
            if client.loop(timeout=_STEP_S) != self._paho.MQTT_ERR_SUCCESS and not holds():
                raise ConnectionError

    def _topic(self, message: Message) -> str:
        kind = re.sub(r"[^\w-]", "_", message.kind)
        return self._receiver.topic_of(
            site=message.site, asset=message.asset, kind=kind, severity=message.severity
        )

    def _labels(self, message: Message) -> Any:
        labels = self._properties()
        labels.ContentType = "application/json"
        labels.UserProperty = [
            ("idempotency-key", message.key), ("slowtime-event", message.event),
        ]  # fmt: skip
        return labels

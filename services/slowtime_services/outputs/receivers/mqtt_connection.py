"""A connection to an MQTT broker that is kept open, by paho-mqtt, an extra of the package."""

import contextlib
import ssl
import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from slowtime_services.outputs.batch import NotSentError
from slowtime_services.outputs.secret_files import user_and_password
from slowtime_services.outputs.settings import MqttSettings, SparkplugSettings
from slowtime_services.reasons import reason_of

MOST_IN_FLIGHT = 100
"""Messages that wait for the broker's acknowledgement; Mosquitto keeps 1000 by default."""


class Will(NamedTuple):
    """A message that the broker sends when the connection breaks."""

    topic: str
    payload: bytes
    qos: int
    retain: bool


class MqttConnection:
    """Connects once; after a failure another one is made.

    Parameters
    ----------
    hears
        Topic → function that is called with the payload of each message, in the thread of the
        connection.

    Raises
    ------
    NotSentError
        Where paho-mqtt is not installed, or the broker does not accept the connection.
    """

    def __init__(
        self,
        settings: MqttSettings | SparkplugSettings,
        client_id: str,
        will: Will,
        hears: dict[str, Callable[[bytes], None]],
    ) -> None:
        self._paho = paho_client()
        self._settings, self._hears = settings, hears
        self._timeout_s = settings.timeout_s
        self._answered = threading.Event()
        self._answer: Any = None
        self._subscribed: set[int] = set()
        self._changed = threading.Condition()
        self._is_open = False
        self._client = self._make(client_id, will)
        try:
            self._open()
        except NotSentError:
            self.close()
            raise

    def _make(self, client_id: str, will: Will) -> Any:
        settings = self._settings
        client = self._paho.Client(
            self._paho.CallbackAPIVersion.VERSION2,
            client_id=client_id,
            protocol=self._paho.MQTTv311,
            clean_session=True,
            reconnect_on_failure=False,
        )
        client.connect_timeout = self._timeout_s
        client.max_inflight_messages_set(MOST_IN_FLIGHT)
        client.will_set(*will)
        if (known := user_and_password(settings.credentials_file)) is not None:
            client.username_pw_set(*known)
        if settings.tls:
            ca = None if settings.ca is None else str(settings.ca)
            client.tls_set_context(ssl.create_default_context(cafile=ca))
        client.on_connect = self._connected
        client.on_disconnect = self._disconnected
        client.on_message = self._heard
        client.on_subscribe = self._acknowledged
        return client

    def _open(self) -> None:
        try:
            self._client.connect(self._settings.host, self._settings.port, keepalive=30)
        except (OSError, ValueError) as error:
            raise NotSentError(f"The broker: {reason_of(error)}") from error
        self._client.loop_start()
        if not self._answered.wait(self._timeout_s):
            raise NotSentError("The broker did not answer in time.")
        if self._answer.is_failure:
            raise NotSentError(f"The broker refused: {self._answer.getName()}.")
        for topic in self._hears:
            self.subscribe(topic)

    @property
    def is_open(self) -> bool:
        """Whether the connection has not broken."""
        return self._is_open

    def publish(
        self, topic: str, payload: bytes | str, *, qos: int = 1, retain: bool = False
    ) -> Any:
        """Queue a message; what is returned can be waited for."""
        if not self._is_open:
            raise NotSentError("The broker ended the connection.")
        return self._client.publish(topic, payload, qos=qos, retain=retain)

    def wait(self, published: list[Any]) -> None:
        """Wait until the broker has acknowledged messages of quality of service 1.

        Raises
        ------
        NotSentError
            Where it has not in time.
        """
        for one in published:
            until_s = time.monotonic() + self._timeout_s
            while not one.is_published():
                if not self._is_open:
                    raise NotSentError("The broker ended the connection.")
                if time.monotonic() > until_s:
                    raise NotSentError("The broker did not acknowledge in time.")
                with contextlib.suppress(RuntimeError, ValueError):
                    one.wait_for_publish(0.1)

    def subscribe(self, topic: str) -> None:
        """Subscribe, and wait for the broker's answer.

        The broker answers in order, so that it has received whatever was sent before, also
        messages of quality of service 0, which it does not acknowledge.
        """
        _, number = self._client.subscribe(topic, qos=1)
        until_s = time.monotonic() + self._timeout_s
        with self._changed:
            while number not in self._subscribed:
                left_s = until_s - time.monotonic()
                if left_s <= 0.0 or not self._is_open:
                    raise NotSentError("The broker did not answer in time.")
                self._changed.wait(min(left_s, 0.1))
            self._subscribed.discard(number)

    def close(self) -> None:
        """Disconnect in order, so that the will is not sent."""
        with contextlib.suppress(OSError, ValueError):
            self._client.disconnect()
        self._client.loop_stop()

    def _connected(
        self, _client: Any, _data: Any, _flags: Any, reason: Any, _more: Any
    ) -> None:
        self._answer = reason
        self._is_open = not reason.is_failure
        self._answered.set()

    def _disconnected(self, *_given: Any) -> None:
        self._is_open = False
        with self._changed:
            self._changed.notify_all()

    def _heard(self, _client: Any, _data: Any, message: Any) -> None:
        if (hear := self._hears.get(message.topic)) is not None:
            hear(message.payload)

    def _acknowledged(self, _client: Any, _data: Any, number: int, *_given: Any) -> None:
        with self._changed:
            self._subscribed.add(number)
            self._changed.notify_all()


def paho_client() -> Any:
    """Import the driver."""
    try:
        import paho.mqtt.client
    except ImportError as error:
        raise NotSentError(
            "An output by MQTT needs paho-mqtt. Install it: pip install 'slowtime[mqtt]'."
        ) from error
    return paho.mqtt.client

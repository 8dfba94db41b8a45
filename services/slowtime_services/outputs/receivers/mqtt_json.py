"""Publishes states, events and status as plain JSON, and what Home Assistant finds them by."""

import json
from typing import Any

from slowtime_schemas.answers.history import EventModel
from slowtime_schemas.answers.twins import RegisteredTwin, State
from slowtime_services.outputs.batch import Batch, NotSentError
from slowtime_services.outputs.quantities import quantities_of
from slowtime_services.outputs.settings import MqttSettings

from .home_assistant import configurations_of
from .mqtt_connection import MOST_IN_FLIGHT, MqttConnection, Will, paho_client


class MqttOutput:
    """Sends to one broker with quality of service 1.

    Topics are ``PREFIX/SITE/ASSET/state`` and ``.../status``, both retained, and
    ``.../event``. ``PREFIX/bridge/NAME`` is ``online`` or ``offline``.
    """

    is_archive = False

    def __init__(self, name: str, settings: MqttSettings) -> None:
        paho_client()
        self._name, self._settings = name, settings
        self._bridge = f"{settings.prefix}/bridge/{name}"
        self._connection: MqttConnection | None = None
        self._configured: dict[str, str] = {}

    def start(self) -> None:
        """Connect, and say that this output is online."""
        will = Will(self._bridge, b"offline", 1, True)
        # A client id of its own for each output: a broker ends the older of two connections.
        self._connection = MqttConnection(
            self._settings, f"slowtime-{self._name}", will, hears={}
        )
        self._configured = {}
        self._send([(self._bridge, "online", True)])

    def send(self, batch: Batch) -> None:
        """Publish a batch."""
        base = f"{self._settings.prefix}/{batch.site}/{batch.asset}"
        messages = [(f"{base}/event", event_text(one), False) for one in batch.events]
        messages += [(f"{base}/state", state_text(one), True) for one in batch.states]
        messages.append((f"{base}/status", status_text(batch.twin), True))
        self._send([*self._discovery(batch, base), *messages])

    def close(self) -> None:
        """Say that this output is offline, and disconnect."""
        if self._connection is None:
            return
        connection, self._connection = self._connection, None
        try:
            if connection.is_open:
                connection.wait([connection.publish(self._bridge, b"offline", retain=True)])
        except NotSentError:
            pass  # the broker sends the will
        finally:
            connection.close()

    def _discovery(self, batch: Batch, base: str) -> list[tuple[str, str, bool]]:
        """Return the configurations that have changed since they were sent."""
        prefix = self._settings.home_assistant
        if prefix is None:
            return []
        found = []
        configured = configurations_of(batch, prefix, base, self._bridge)
        for topic, text in configured.items():
            if self._configured.get(topic) != text:
                self._configured[topic] = text
                found.append((topic, text, True))
        return found

    def _send(self, messages: list[tuple[str, str, bool]]) -> None:
        connection = self._connection
        assert connection is not None
        for first in range(0, len(messages), MOST_IN_FLIGHT):
            connection.wait(
                [
                    connection.publish(topic, text, retain=retain)
                    for topic, text, retain in messages[first : first + MOST_IN_FLIGHT]
                ]
            )


def state_text(state: State) -> str:
    """Write a state as JSON: each quantity with value, sd, lo and hi where it is estimated."""
    told: dict[str, Any] = {
        "id": state.id,
        "t_ns": state.t_ns,
        "time": state.time.isoformat(),
        "slow_time": state.slow_time,
        "slow_time_unit": state.slow_time_unit,
        "boot": state.boot,
        "sequence": state.sequence,
        "valid": state.valid,
        "reasons": state.reasons,
        "assumed": state.assumed,
    }
    for one in quantities_of(state):
        told[one.name] = None if one.estimate is None else one.estimate.model_dump()
    return json.dumps(told)


def event_text(event: EventModel) -> str:
    """Write an event as JSON; ``event_id`` tells doubles."""
    return json.dumps(event.model_dump(mode="json", exclude={"number"}))


def status_text(twin: RegisteredTwin) -> str:
    """Write what holds of a twin now."""
    conclusion = None if twin.conclusion is None else twin.conclusion.model_dump(mode="json")
    return json.dumps(
        {
            "id": twin.id,
            "alive": twin.alive,
            "raised": [one.model_dump(mode="json") for one in twin.raised],
            "conclusion": conclusion,
        }
    )

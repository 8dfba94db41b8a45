"""An edge node by Sparkplug B: births, data and deaths of the node and of a device a twin.

References
----------
Eclipse Foundation, "Sparkplug Specification" 3.0.0: sections 4 (topics), 5 (session), 6.4.
"""

import threading
import time
from collections.abc import Callable, Iterator

from slowtime_schemas.answers.history import EventModel
from slowtime_schemas.answers.twins import RegisteredTwin, State
from slowtime_services.documents.json_documents import read_json
from slowtime_services.outputs.batch import Batch, NotSentError
from slowtime_services.outputs.quantities import Quantity, quantities_of
from slowtime_services.outputs.settings import SparkplugSettings

from .mqtt_connection import MqttConnection, Will, paho_client
from .sparkplug_payload import (
    BOOLEAN,
    DOUBLE,
    INT64,
    STRING,
    Metric,
    check_installed,
    commands,
    encode,
)

REBIRTH = "Node Control/Rebirth"
RAISED = "alarm/raised"
_EVENT_PARTS = ("id", "kind", "severity", "message")
_NUMBERS = 256
"""Sequence numbers and those of sessions count from 0 to 255, and begin again."""


class Device:
    """A twin that was born: what it is now, and every quantity that it ever had.

    A mode that an epoch lacks stays a metric, so that no birth is due when it comes back.
    """

    def __init__(self, twin: RegisteredTwin) -> None:
        self.twin = twin
        self._quantities: dict[str, Quantity] = {}
        self._names: frozenset[str] = frozenset()

    def update(self, twin: RegisteredTwin) -> None:
        """Take over a twin as it is now."""
        gone = {name: one._replace(estimate=None) for name, one in self._quantities.items()}
        self.twin = twin
        self._quantities = gone | {one.name: one for one in quantities_of(twin)}

    def lacks(self, twin: RegisteredTwin) -> bool:
        """Whether a twin has a quantity that was not born."""
        return any(one.name not in self._names for one in quantities_of(twin))

    def has(self, name: str) -> bool:
        """Whether a metric of this name was born."""
        return name in self._names

    def birth(self, now_ns: int) -> Iterator[Metric]:
        """Yield every metric with its present value and its unit."""
        metrics = list(self._birth_metrics(now_ns))
        self._names = frozenset(one.name for one in metrics)
        yield from metrics

    def _birth_metrics(self, now_ns: int) -> Iterator[Metric]:
        twin = self.twin
        t_ns = now_ns if twin.t_ns is None else twin.t_ns
        for one in self._quantities.values():
            properties = {"engUnit": one.unit} if one.unit else {}
            for name, value in _parts(one):
                yield Metric(name, DOUBLE, value, t_ns, properties=properties)
        yield Metric("valid", BOOLEAN, twin.valid, t_ns)
        yield Metric("slow_time", DOUBLE, twin.slow_time, t_ns)
        yield Metric(RAISED, BOOLEAN, bool(twin.raised), now_ns)
        for name in _EVENT_PARTS:
            yield Metric(f"event/{name}", STRING, None, now_ns)


class _HostState:
    """What the primary host application says of itself: online, and since when [ms]."""

    def __init__(self) -> None:
        self.is_online, self.since_ms = False, 0
        self._changed = threading.Condition()

    def hear(self, payload: bytes) -> None:
        """Take over a STATE message; one that is none says nothing."""
        try:
            told = read_json(payload)
            is_online, since_ms = told["online"] is True, int(told.get("timestamp", 0))
        except (ValueError, TypeError, KeyError, AttributeError):
            return
        with self._changed:
            self.is_online, self.since_ms = is_online, since_ms
            self._changed.notify_all()

    def await_later(self, before: "_HostState", timeout_s: float) -> None:
        """Wait for the host, and after a broken connection for a host that connects again.

        A broker that was restarted has kept the message of before. Where only this connection
        broke, the host tells nothing new, and after the time limit that message counts [s].
        """
        with self._changed:
            self._changed.wait_for(
                lambda: self.is_online and self.since_ms > before.since_ms, timeout_s
            )


class SparkplugOutput:
    """The edge node.

    Its messages have quality of service 0, as the specification demands. A batch counts as
    sent once the broker has answered a subscription that followed it on the same connection.
    """

    is_archive = False

    def __init__(
        self, name: str, settings: SparkplugSettings, now_ns: Callable[[], int] = time.time_ns
    ) -> None:
        paho_client()
        check_installed()
        self._name, self._settings, self._now_ns = name, settings, now_ns
        self._connection: MqttConnection | None = None
        self._session, self._sequence = -1, 0
        self._devices: dict[str, Device] = {}
        # Commands come in the thread of the connection, between the messages of a batch.
        self._lock = threading.RLock()
        self._host = _HostState()

    def start(self) -> None:
        """Begin a session: the birth of the node; births of devices follow with their data."""
        settings = self._settings
        self._session = (self._session + 1) % _NUMBERS
        self._devices = {}
        known_host = self._host
        self._host = _HostState()
        death = encode([self._session_metric()], self._now_ns(), None)
        will = Will(self._topic("NDEATH"), death, 1, False)
        hears: dict[str, Callable[[bytes], None]] = {self._topic("NCMD"): self._command}
        if settings.primary_host is not None:
            hears[f"spBv1.0/STATE/{settings.primary_host}"] = self._host.hear
        self._connection = MqttConnection(settings, f"slowtime-{self._name}", will, hears)
        if settings.primary_host is not None:
            self._host.await_later(known_host, settings.timeout_s)
            self._check_host()
        with self._lock:
            self._node_birth()

    def send(self, batch: Batch) -> None:
        """Publish the states and events of a twin, with a birth or death where it is due."""
        connection = self._connection
        assert connection is not None
        self._check_host()
        twin = batch.twin
        for state, is_historical in _with_history(batch):
            self._device_data(twin, list(_metrics_of(state, is_historical)))
        for event in batch.events:
            self._device_data(twin, list(_metrics_of_event(event)))
        with self._lock:
            self._tell_status(twin)
        connection.subscribe(self._topic("NCMD"))
        self._check_host()

    def close(self) -> None:
        """End the session: the death of the node, as the will would be sent."""
        if self._connection is None:
            return
        connection, self._connection = self._connection, None
        try:
            if connection.is_open:
                death = encode([self._session_metric()], self._now_ns(), None)
                connection.wait([connection.publish(self._topic("NDEATH"), death, qos=1)])
        except NotSentError:
            pass  # the broker sends the will
        finally:
            connection.close()

    def _topic(self, kind: str, device: str = "") -> str:
        base = f"spBv1.0/{self._settings.group}/{kind}/{self._settings.node}"
        return f"{base}/{device}" if device else base

    def _session_metric(self) -> Metric:
        return Metric("bdSeq", INT64, self._session, self._now_ns())

    def _node_birth(self) -> None:
        self._sequence = 0
        now_ns = self._now_ns()
        metrics = [self._session_metric(), Metric(REBIRTH, BOOLEAN, False, now_ns)]
        self._publish("NBIRTH", metrics)

    def _device_data(self, twin: RegisteredTwin, metrics: list[Metric]) -> None:
        with self._lock:
            if (device := self._devices.get(twin.id)) is None or device.lacks(twin):
                device = self._device_birth(twin)
            # Of an older state, what the twin does not estimate any more was not born.
            born = [one for one in metrics if device.has(one.name)]
            self._publish("DDATA", born, twin.id)

    def _device_birth(self, twin: RegisteredTwin) -> "Device":
        device = self._devices.get(twin.id) or Device(twin)
        device.update(twin)
        self._devices[twin.id] = device
        self._publish("DBIRTH", list(device.birth(self._now_ns())), twin.id)
        return device

    def _tell_status(self, twin: RegisteredTwin) -> None:
        """Tell whether alarms are raised; a device dies with its edge agent."""
        device = self._devices.get(twin.id)
        if device is None or device.lacks(twin):
            if twin.alive:
                self._device_birth(twin)
            return
        before = device.twin
        device.update(twin)
        if before.alive and not twin.alive:
            del self._devices[twin.id]
            self._publish("DDEATH", [], twin.id)
        elif bool(before.raised) != bool(twin.raised):
            metric = Metric(RAISED, BOOLEAN, bool(twin.raised), self._now_ns())
            self._publish("DDATA", [metric], twin.id)

    def _publish(self, kind: str, metrics: list[Metric], device: str = "") -> None:
        connection = self._connection
        if connection is None:
            return
        payload = encode(metrics, self._now_ns(), self._sequence)
        self._sequence = (self._sequence + 1) % _NUMBERS
        connection.publish(self._topic(kind, device), payload, qos=0)

    def _command(self, payload: bytes) -> None:
        """Tell all births again, where a host application asks for it."""
        try:
            is_wanted = commands(payload).get(REBIRTH, False)
        except ValueError:
            return
        if not is_wanted:
            return
        with self._lock:
            try:
                self._node_birth()
                for device in list(self._devices.values()):
                    self._device_birth(device.twin)
            except NotSentError:
                pass  # the next session begins with births

    def _check_host(self) -> None:
        host = self._settings.primary_host
        if host is not None and not self._host.is_online:
            raise NotSentError(f"The primary host application {host} is offline.")


def _with_history(batch: Batch) -> Iterator[tuple[State, bool]]:
    """Yield each state, and whether a newer one follows it."""
    last = len(batch.states) - 1
    for number, state in enumerate(batch.states):
        yield state, number < last or not batch.is_latest


def _metrics_of(state: State, is_historical: bool) -> Iterator[Metric]:
    for one in quantities_of(state):
        if one.estimate is not None:
            for name, value in _parts(one):
                yield Metric(name, DOUBLE, value, state.t_ns, is_historical)
    yield Metric("valid", BOOLEAN, state.valid, state.t_ns, is_historical)
    yield Metric("slow_time", DOUBLE, state.slow_time, state.t_ns, is_historical)


def _metrics_of_event(event: EventModel) -> Iterator[Metric]:
    told = (event.event_id, event.kind, event.severity, event.message)
    for name, value in zip(_EVENT_PARTS, told, strict=True):
        yield Metric(f"event/{name}", STRING, value, event.t_ns)


def _parts(one: Quantity) -> Iterator[tuple[str, float | None]]:
    estimate = one.estimate
    yield one.name, None if estimate is None else estimate.value
    yield f"{one.name}/sd", None if estimate is None else estimate.sd

"""An OPC UA server whose objects are twins, by asyncua, an extra of the package.

Values carry the time of the sensors, standard deviation, unit and range; a reading that is not
valid is of uncertain quality, and that of an agent that is offline the last usable one. Events
of the server are the events of the twins.
"""

import asyncio
import datetime
import threading
from collections.abc import Coroutine
from pathlib import Path
from typing import Any, TypeVar

from slowtime_schemas.answers.history import EventModel
from slowtime_schemas.answers.twins import RegisteredTwin
from slowtime_services.outputs.batch import Batch, NotSentError
from slowtime_services.outputs.quantities import Quantity, quantities_of
from slowtime_services.outputs.secret_files import user_and_password
from slowtime_services.outputs.settings import OpcUaSettings
from slowtime_services.reasons import reason_of

STARTING_S = 120.0
"""How long the server may take to load the standard's own nodes [s]; some seconds of a core."""
NAMESPACE = "urn:slowtime:twins"
SEVERITIES = {"info": 100, "warning": 500, "alarm": 900}
"""Of OPC UA, from 1 to 1000: low, medium and high (Part 5, 6.4.2)."""
RANGES = {"frequency_hz": (0.0, 1_000.0), "damping_ratio": (0.0, 1.0)}
"""Normal range of a value by the last part of its name; a change is between -1 and 1."""
UNECE = {"Hz": ("HTZ", "Hz", "hertz"), "": ("C62", "1", "one")}
"""Unit → code of UNECE recommendation 20, symbol and name."""
_EPOCH = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
_Answer = TypeVar("_Answer")


class OpcUaOutput:
    """The server, in a thread with an event loop of its own."""

    is_archive = False

    def __init__(self, _name: str, settings: OpcUaSettings) -> None:
        try:
            import asyncua
        except ImportError as error:
            raise NotSentError(
                "An output by OPC UA needs asyncua. Install it: pip install 'slowtime[opcua]'."
            ) from error
        self._asyncua: Any = asyncua
        self._settings = settings
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._space: AddressSpace | None = None

    def start(self) -> None:
        """Listen for clients."""
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(
            target=self._loop.run_forever, name="output-opcua", daemon=True
        )
        self._thread.start()
        try:
            self._space = self._wait(serve(self._asyncua, self._settings), STARTING_S)
        except (OSError, ValueError, self._asyncua.ua.UaError) as error:
            raise NotSentError(f"The OPC UA server: {reason_of(error)}") from error

    def send(self, batch: Batch) -> None:
        """Write the present values of a twin, and tell its events."""
        assert self._space is not None
        self._wait(self._space.write(batch.twin))
        for event in batch.events:
            self._wait(self._space.tell(batch.twin, event))

    def close(self) -> None:
        """End all sessions."""
        loop, self._loop = self._loop, None
        if loop is None or self._thread is None:
            return
        if self._space is not None:
            stopping = asyncio.run_coroutine_threadsafe(self._space.stop(), loop)
            try:
                stopping.result(self._settings.timeout_s)
            except TimeoutError:
                stopping.cancel()
            self._space = None
        loop.call_soon_threadsafe(loop.stop)
        self._thread.join(self._settings.timeout_s)
        if not self._thread.is_alive():
            loop.close()

    def _wait(
        self, work: Coroutine[Any, Any, _Answer], timeout_s: float | None = None
    ) -> _Answer:
        assert self._loop is not None
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return future.result(timeout_s or self._settings.timeout_s)
        except TimeoutError as error:
            future.cancel()
            raise NotSentError("The OPC UA server did not answer in time.") from error


class AddressSpace:
    """Sites, twins and variables of a running server."""

    def __init__(self, asyncua: Any, server: Any, index: int, root: Any, events: Any) -> None:
        self._ua, self._server, self._index = asyncua.ua, server, index
        self._root, self._events = root, events
        self._nodes: dict[str, Any] = {}

    async def stop(self) -> None:
        """End the server."""
        await self._server.stop()

    async def write(self, twin: RegisteredTwin) -> None:
        """Write every variable of a twin; variables are made when they are needed first."""
        status = self._ua.StatusCode(self._quality(twin))
        source = None if twin.t_ns is None else _time(twin.t_ns)
        for one in quantities_of(twin):
            variable = await self._variable(twin, one)
            deviation = self._nodes[f"{twin.id}/{one.name}/StandardDeviation"]
            estimate = one.estimate
            for node, value in (
                (variable, None if estimate is None else estimate.value),
                (deviation, None if estimate is None else estimate.sd),
            ):
                await self._set(node, value, self._ua.VariantType.Double, status, source)
        plain: tuple[tuple[str, Any, str], ...] = (
            ("valid", twin.valid, "Boolean"),
            ("alive", twin.alive, "Boolean"),
            ("alarm_raised", bool(twin.raised), "Boolean"),
            ("reasons", " ".join(twin.reasons), "String"),
        )
        good = self._ua.StatusCode(self._ua.StatusCodes.Good)
        for name, value, kind in plain:
            variant = getattr(self._ua.VariantType, kind)
            node = await self._plain_variable(twin, name, value, variant)
            await self._set(node, value, variant, good, source)

    async def tell(self, twin: RegisteredTwin, event: EventModel) -> None:
        """Send an event to the clients that have subscribed to events."""
        told = self._events.event
        owner = await self._object(twin)
        told.Message = self._ua.LocalizedText(event.message)
        told.Severity = SEVERITIES[event.severity]
        told.SourceName = twin.id
        told.SourceNode = owner.nodeid
        told.Time = _time(event.t_ns)
        told.Kind, told.SlowtimeEventId = event.kind, event.event_id
        await self._events.trigger()

    def _quality(self, twin: RegisteredTwin) -> int:
        codes = self._ua.StatusCodes
        if twin.t_ns is None:
            return int(codes.BadWaitingForInitialData)
        if not twin.alive:
            return int(codes.UncertainLastUsableValue)
        return int(codes.Good if twin.valid else codes.UncertainSubNormal)

    async def _set(self, node: Any, value: Any, kind: Any, status: Any, source: Any) -> None:
        ua = self._ua
        if value is None:
            status = ua.StatusCode(ua.StatusCodes.BadNoData)
        now = datetime.datetime.now(datetime.UTC)
        variant = ua.Variant(value, kind if value is not None else ua.VariantType.Null)
        await node.write_value(ua.DataValue(variant, status, source, now))

    async def _object(self, twin: RegisteredTwin) -> Any:
        if twin.id not in self._nodes:
            site = twin.id.partition(".")[0]
            if site not in self._nodes:
                self._nodes[site] = await self._root.add_folder(
                    self._id(site), self._name(site)
                )
            made = await self._nodes[site].add_object(self._id(twin.id), self._name(twin.id))
            self._nodes[twin.id] = made
        return self._nodes[twin.id]

    async def _variable(self, twin: RegisteredTwin, one: Quantity) -> Any:
        key = f"{twin.id}/{one.name}"
        if key not in self._nodes:
            ua, owner = self._ua, await self._object(twin)
            made = await owner.add_variable(
                self._id(key), self._name(one.name), 0.0,
                varianttype=ua.VariantType.Double, datatype=ua.ObjectIds.Double,
            )  # fmt: skip
            low, high = RANGES.get(one.name.rpartition("/")[2], (-1.0, 1.0))
            code, symbol, label = UNECE[one.unit]
            unit = ua.EUInformation(
                NamespaceUri="http://www.opcfoundation.org/UA/units/un/cefact",
                UnitId=int.from_bytes(code.encode(), "big"),  # Part 8, 5.6.3
                DisplayName=ua.LocalizedText(symbol), Description=ua.LocalizedText(label),
            )  # fmt: skip
            base = ua.QualifiedName
            await made.add_property(self._id(f"{key}/EURange"), base("EURange", 0),
                                    ua.Range(Low=low, High=high))  # fmt: skip
            await made.add_property(
                self._id(f"{key}/EngineeringUnits"), base("EngineeringUnits", 0), unit
            )
            deviation = f"{key}/StandardDeviation"
            self._nodes[deviation] = await made.add_property(
                self._id(deviation), self._name("StandardDeviation"), 0.0,
                varianttype=ua.VariantType.Double, datatype=ua.ObjectIds.Double,
            )  # fmt: skip
            self._nodes[key] = made
        return self._nodes[key]

    async def _plain_variable(
        self, twin: RegisteredTwin, name: str, value: Any, kind: Any
    ) -> Any:
        key = f"{twin.id}/{name}"
        if key not in self._nodes:
            owner = await self._object(twin)
            self._nodes[key] = await owner.add_variable(
                self._id(key), self._name(name), value, varianttype=kind
            )
        return self._nodes[key]

    def _id(self, text: str) -> Any:
        return self._ua.NodeId(text, self._index)

    def _name(self, text: str) -> Any:
        return self._ua.QualifiedName(text, self._index)


async def serve(asyncua: Any, settings: OpcUaSettings) -> AddressSpace:
    """Start a server with an empty folder of twins."""
    server = asyncua.Server(user_manager=_users(asyncua, settings))
    await server.init()
    server.set_endpoint(f"opc.tcp://{settings.host}:{settings.port}/slowtime/")
    server.set_server_name("slowtime")
    await _secure(asyncua, server, settings)
    index = await server.register_namespace(NAMESPACE)
    root = await server.nodes.objects.add_folder(
        asyncua.ua.NodeId("twins", index), asyncua.ua.QualifiedName("slowtime", index)
    )
    kind = await server.create_custom_event_type(
        index, "SlowtimeEventType", asyncua.ua.ObjectIds.BaseEventType,
        [
            ("Kind", asyncua.ua.VariantType.String),
            ("SlowtimeEventId", asyncua.ua.VariantType.String),
        ],
    )  # fmt: skip
    events = await server.get_event_generator(kind, server.nodes.server)
    await server.start()
    return AddressSpace(asyncua, server, index, root, events)


async def _secure(asyncua: Any, server: Any, settings: OpcUaSettings) -> None:
    policies = asyncua.ua.SecurityPolicyType
    if settings.certificate is None:
        server.set_security_policy([policies.NoSecurity])
        return
    assert settings.key is not None  # the settings have both or neither
    await server.load_certificate(*_with_format(settings.certificate))
    key, form = _with_format(settings.key)
    await server.load_private_key(key, format=form)
    server.set_security_policy([policies.Basic256Sha256_SignAndEncrypt])


def _with_format(path: Path) -> tuple[bytes, str]:
    """Return the content of a file and its format, which asyncua reads from its name only."""
    content = path.read_bytes()
    return content, "pem" if content.lstrip().startswith(b"-----BEGIN") else "der"


def _users(asyncua: Any, settings: OpcUaSettings) -> Any:
    """Return who may read; nobody may write."""
    from asyncua.crypto.permission_rules import User, UserRole

    known = user_and_password(settings.credentials_file)

    class Readers:
        def get_user(
            self,
            _server: Any,
            username: Any = None,
            password: Any = None,
            certificate: Any = None,
        ) -> Any:
            if known is not None and (username, password) != known:
                return None
            return User(role=UserRole.User, name=username or "reader")

    return Readers()


def _time(t_ns: int) -> datetime.datetime:
    return _EPOCH + datetime.timedelta(microseconds=t_ns // 1_000)

"""The registry of URL schemes of live sources."""

import dataclasses
import importlib
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import urlsplit

from edge_agent.inputs import LiveInput
from slowtime_services.bus import Bus
from slowtime_services.clock import Clock
from slowtime_services.plugins.discovery import plugins

from .formats.decoding import AnyLayout, Decoder

if TYPE_CHECKING:
    from .reader import Transport


class TransportContext(NamedTuple):
    """Clock, bus and twin id that a transport may use besides its settings."""

    clock: Clock
    bus: Bus | None = None
    twin: tuple[str, str] = ("", "")
    """Site and asset."""


class Opened(NamedTuple):
    """A transport that is ready to connect, and the layout and rate that it detected."""

    transport: "Transport"
    layout: AnyLayout | None
    """None where the first message says so: see `Describing`."""
    rate_hz: float | None
    decode: Decoder | None = None
    """For messages that are no layout's."""


Open = Callable[[LiveInput, TransportContext], Opened]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Scheme:
    """One kind of URL.

    Parameters
    ----------
    opens
        Module of `transports` whose function `opened` makes the transport.
    packets
        What the transport delivers.
    library, extra
        Distribution that it needs, and the extra that installs it; empty for none.
    parameters
        What may stand behind `?`, besides layout and limits.
    """

    name: str
    says: str
    example: str
    opens: str
    packets: str = "messages"
    library: str = ""
    extra: str = ""
    parameters: Mapping[str, str] = dataclasses.field(default_factory=dict)


_MQTT = {
    "qos": "0, 1 (default) or 2",
    "client_id": "a name, under which messages wait while the connection is lost",
}
_TCP = {"timeout_s": "of connecting"}
SCHEMES: dict[str, Scheme] = {
    scheme.name: scheme
    for scheme in (
        Scheme(
            name="mqtt",
            says="topics of an MQTT broker",
            example="mqtt://pi@10.0.0.2:1883/bridge/accel?channels=x,y,z&counter=n&rate_hz=200",
            opens="mqtt",
            library="paho-mqtt",
            extra="mqtt",
            parameters=_MQTT,
        ),
        Scheme(
            name="mqtts",
            says="the same, over TLS",
            example="mqtts://pi@broker.example/bridge/accel?channels=x,y,z&rate_hz=200",
            opens="mqtt",
            library="paho-mqtt",
            extra="mqtt",
            parameters=_MQTT,
        ),
        Scheme(
            name="tcp",
            says="a TCP server to connect to",
            example="tcp://10.0.0.5:4001?layout=csv&channels=x,y,z&rate_hz=200",
            opens="tcp",
            packets="a byte stream",
            parameters=_TCP,
        ),
        Scheme(
            name="tcp-listen",
            says="a device that connects to this port",
            example="tcp-listen://127.0.0.1:4001?layout=csv&channels=x,y,z&rate_hz=200",
            opens="tcp",
            packets="a byte stream",
        ),
        Scheme(
            name="udp",
            says="datagrams to this port",
            example="udp://0.0.0.0:5005?layout=frame.toml&rate_hz=1000",
            opens="udp",
        ),
        Scheme(
            name="serial",
            says="a serial port",
            example="serial:///dev/ttyUSB0?baud=115200&layout=csv&channels=x,y,z&rate_hz=200",
            opens="serial",
            packets="a byte stream",
            library="pyserial",
            extra="serial",
            parameters={"baud": "bits per second; 115200 by default"},
        ),
        Scheme(
            name="stdin",
            says="standard input: the output of any program",
            example="stdin:?layout=csv&channels=x,y,z&rate_hz=200",
            opens="stdin",
            packets="a byte stream",
        ),
        Scheme(
            name="zenoh",
            says="`samples` messages, or any layout, on the bus of slowtime",
            example="zenoh:",
            opens="zenoh",
        ),
        Scheme(
            name="iio",
            says="a device of Linux industrial I/O, by its buffer",
            example="iio:///iio:device0?channels=accel_x,accel_y,accel_z",
            opens="iio",
            packets="a byte stream",
            parameters={
                "channels": "scan elements; by default those that are enabled, or all",
                "length": "of the kernel's buffer, in samples; 4096 by default",
            },
        ),
        Scheme(
            name="opcua",
            says="variables of an OPC UA server",
            example="opcua://10.0.0.9:4840/?channels=ns=2;s=ax,ns=2;s=ay&rate_hz=10",
            opens="opcua",
            library="asyncua",
            extra="opcua",
            parameters={
                "channels": "ids of the variables",
                "interval_ms": "publishing interval; 100 by default",
            },
        ),
    )
}  # fmt: skip


def scheme_of(url: str) -> Scheme:
    """Return the scheme of a URL."""
    name = urlsplit(url).scheme
    if name in SCHEMES:
        return SCHEMES[name]
    own = {part.name: part for part in plugins("slowtime.sources")}
    if name not in own:
        allowed = ", ".join([*SCHEMES, *own])
        raise ValueError(
            f"{url!r:.200} has the scheme {name!r}. Allowed: {allowed}; "
            f"such as {SCHEMES['mqtt'].example}."
        )
    brought = f"of {own[name].distribution} {own[name].version}"
    return Scheme(name=name, says=brought, example=f"{name}:", opens="plugin")


def check(settings: LiveInput) -> Scheme:
    """Refuse a scheme, parameter or library that there is none of.

    Raises `ValueError` that says what is allowed, or what to install.
    """
    scheme = scheme_of(settings.source)
    unknown = sorted(set(settings.parameters) - set(scheme.parameters))
    if unknown and scheme.opens != "plugin":
        allowed = ", ".join(scheme.parameters) or "none but layout and limits"
        raise ValueError(f"{scheme.name}: has no parameter {unknown}. Allowed: {allowed}.")
    importing(scheme)
    return scheme


def importing(scheme: Scheme) -> Open:
    """Import the module that opens a scheme.

    Raises `ValueError` where its library is not installed.
    """
    try:
        module = importlib.import_module(f"{__package__}.transports.{scheme.opens}")
    except ModuleNotFoundError as error:
        if not scheme.library:
            raise
        raise ValueError(
            f"{scheme.name}: needs {scheme.library}, which is not installed. Install it: "
            f"pip install 'slowtime[{scheme.extra}]'."
        ) from error
    opened: Open = module.opened
    return opened


def declared(settings: LiveInput, scheme: str) -> tuple[AnyLayout, float]:
    """Layout and rate of the settings, for a transport that cannot find them out.

    Raises `ValueError` where one of them is missing.
    """
    if settings.layout is None:
        raise ValueError(
            f"{scheme}: does not say what its messages hold. Declare it in the URL, such as "
            "?layout=csv&channels=x,y,z, or by ?layout=FILE.toml, or as input.layout."
        )
    if settings.rate_hz is None:
        raise ValueError(
            f"{scheme}: does not say its nominal rate. Give rate_hz: ?rate_hz=200, --rate-hz "
            "or input.rate_hz."
        )
    return settings.layout, settings.rate_hz

"""The URL of a live sensor, the layout of its messages, and its limits.

A URL says where and, after `?`, what: ``mqtt://pi@10.0.0.2/bridge/accel?channels=x,y,z&counter=n``.
"""

import math
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import parse_qsl, urlencode, urlsplit, urlunsplit

from pydantic import Field, model_validator

from slowtime_schemas.quantities import LEAST_RATE_HZ, MOST_RATE_HZ, Frozen, Name

from .layouts import CsvLayout, JsonLayout, Layout, PackedLayout, read_layout

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]

Rate = Annotated[float, Field(ge=LEAST_RATE_HZ, le=MOST_RATE_HZ)]

LAYOUT_WORDS = {
    "layout": "json, csv, packed, or a TOML or JSON file that declares it",
    "channels": "names of the channels: x,y,z",
    "unit": "unit of the channels",
    "scale": "unit for one count",
    "counter": "where the counter is",
    "counter_bits": "width of the counter, where it wraps",
    "counter_counts": "samples or messages",
    "stamp": "where the device's time is",
    "stamp_unit": "s, ms, us or ns",
    "stamp_clock": "utc or device",
    "delimiter": "between the numbers of a line",
    "columns": "names of the columns of a line: n,t,x,y,z",
}
"""Parameters of a URL that declare a layout."""

DESCRIBED = ("iio", "opcua")
"""Schemes whose devices say what they send: `channels` chooses among that."""

LIMIT_WORDS = ("rate_hz", "block_s", "silent_after_s")
"""Parameters of a URL that are settings of the input."""


class LiveInput(Frozen):
    """Samples of a live sensor.

    Examples
    --------
    >>> live = LiveInput.of("udp://127.0.0.1:5005?layout=csv&channels=x,y&rate_hz=200")
    >>> live.source, live.rate_hz, live.layout.names
    ('udp://127.0.0.1:5005', 200.0, ('x', 'y'))
    """

    kind: Literal["live"] = "live"
    source: str
    """URL of the source; `slowtime edge --help` lists the schemes."""
    layout: Layout | None = None
    """What a message or line holds; None where the source says so itself."""
    rate_hz: Rate | None = None
    """Nominal samples per second; None where the source says so itself. The true rate is
    estimated, with its uncertainty."""
    block_s: Positive = 0.5
    """Samples are handed on in blocks of about this length."""
    silent_after_s: Positive = 10.0
    """A sensor that sends nothing for so long is reported as silent."""
    reorder_s: NotNegative = 0.25
    """How long a sample that came early waits for those before it."""
    queue_samples: Annotated[int, Field(ge=100, le=100_000_000)] = 1_000_000
    """What waits at most for the work to be done; what comes beyond is dropped and counted."""
    rate_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.05
    """A relative difference to `rate_hz` that lasts is another rate, not an inexact clock."""
    units: tuple[str, ...] = ()
    """Units of the samples, `UNIT` of all channels or `CHANNEL=UNIT`; they override layout and
    device. Motion is converted to SI."""
    sensitivities: tuple[str, ...] = ()
    """What volts or counts mean: `100mV/g`, `CHANNEL=256LSB/g`."""
    password_file: Path | None = None
    """File that holds the password of the user named in the URL."""
    ca_file: Path | None = None
    """Certificates (PEM) that a TLS server is checked against; None for the system's."""
    certificate_file: Path | None = None
    """Certificate (PEM) to show to a TLS server; None for none."""
    key_file: Path | None = None
    """Private key (PEM) of that certificate."""
    sysfs: Path = Path("/")
    """Root of `sys/bus/iio` and `dev`, of industrial I/O."""

    @classmethod
    def of(cls, url: str, **more: Any) -> "LiveInput":
        """Split a URL into source, layout and limits.

        Raises
        ------
        ValueError
            Where the layout that it declares cannot be.
        """
        parts = urlsplit(url)
        words = dict(parse_qsl(parts.query, keep_blank_values=True))
        declares = parts.scheme not in DESCRIBED
        said = {name: words.pop(name) for name in LAYOUT_WORDS if declares and name in words}
        given: dict[str, Any] = {name: words.pop(name) for name in LIMIT_WORDS if name in words}
        # urlunsplit would turn `stdin:` with nothing behind into `stdin`.
        bare = url.partition("?")[0]
        query = urlencode(words, safe="/:=")
        given["source"] = f"{bare}?{query}" if query else bare
        if said:
            given["layout"] = _layout_of(said)
        return cls(**(given | more))

    @model_validator(mode="after")
    def _keeps_passwords_out(self) -> "LiveInput":
        parts = urlsplit(self.source)
        if not parts.scheme:
            raise ValueError(
                f"source={self.source!r} names no scheme. Give a URL such as "
                "mqtt://127.0.0.1/topic, tcp://10.0.0.2:5000 or stdin:."
            )
        if parts.password is not None:
            raise ValueError(
                "The URL of the source holds a password, which would be seen in the list of "
                "processes. Write it into a file, and give password_file."
            )
        return self

    @property
    def scheme(self) -> str:
        """First part of the URL."""
        return urlsplit(self.source).scheme

    @property
    def bare(self) -> str:
        """The URL without its query."""
        return urlunsplit(urlsplit(self.source)._replace(query=""))

    @property
    def parameters(self) -> dict[str, str]:
        """Parameters of the transport, behind `?` of the URL."""
        return dict(parse_qsl(urlsplit(self.source).query, keep_blank_values=True))

    @property
    def password(self) -> str | None:
        """First line of the password file."""
        if self.password_file is None:
            return None
        return self.password_file.read_text().partition("\n")[0]


class BoardInput(LiveInput):
    """One of several boards on a structure."""

    name: Name


class BoardsInput(Frozen):
    """Several live boards on one structure, each with a clock of its own."""

    kind: Literal["boards"] = "boards"
    boards: Annotated[tuple[BoardInput, ...], Field(min_length=2, max_length=64)]

    @model_validator(mode="after")
    def _names_differ(self) -> "BoardsInput":
        names = [board.name for board in self.boards]
        if len(set(names)) < len(names):
            raise ValueError(f"Boards {names} are not told apart. Give each its own name.")
        return self


def _layout_of(said: dict[str, str]) -> JsonLayout | CsvLayout | PackedLayout:
    """Make a layout from the query of a URL."""
    kind = said.get("layout", "json")
    if "." in kind:
        if len(said) > 1:
            raise ValueError(
                f"layout={kind} is a file, and {sorted(set(said) - {'layout'})} were given as "
                "well. Write them into that file."
            )
        return read_layout(Path(kind))
    kinds: dict[str, type[JsonLayout] | type[CsvLayout] | type[PackedLayout]] = {
        "json": JsonLayout, "csv": CsvLayout, "packed": PackedLayout,
    }  # fmt: skip
    if kind not in kinds:
        raise ValueError(
            f"layout={kind!r} is not a valid layout. Allowed: json, csv, packed, or a .toml "
            "or .json file."
        )
    scale, unit = float(said.get("scale", "1")), said.get("unit", "m/s^2")
    if not math.isfinite(scale):
        raise ValueError(f"scale={scale} is not finite. Give units for one count.")
    table: dict[str, Any] = {
        "channels": [
            {"name": name, "unit": unit, "scale": scale}
            for name in said.get("channels", "x,y,z").split(",")
        ]
    }
    if "counter" in said:
        table["counter"] = {
            "at": said["counter"],
            "bits": said.get("counter_bits", 64),
            "counts": said.get("counter_counts", "samples"),
        }
    if "stamp" in said:
        table["stamp"] = {
            "at": said["stamp"],
            "unit": said.get("stamp_unit", "us"),
            "clock": said.get("stamp_clock", "device"),
        }
    if kind == "csv":
        if "delimiter" in said:
            table["delimiter"] = said["delimiter"]
        if "columns" in said:
            table["columns"] = said["columns"].split(",")
    return kinds[kind].model_validate(table)

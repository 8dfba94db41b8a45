"""The layouts of sensor messages: channels, counter and stamp, and the place of each.

A layout is declared, never guessed. It is a table of TOML or JSON::

    kind = "json"
    counter = {at = "n", bits = 16}
    stamp = {at = "t_us", unit = "us", clock = "device"}

    [[channels]]
    name = "x"
    at = "accel.x"
    unit = "m/s^2"
    scale = 3.81e-5
"""

import struct
from collections import Counter as Tally
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field, FiniteFloat, TypeAdapter, ValidationError, model_validator

from slowtime_schemas.quantities import Frozen, Plain, PlainText, UnitName
from slowtime_services.documents.bounds import DocumentError
from slowtime_services.documents.document_files import read_settings_file

NUMBERS = {
    "i8": 1, "u8": 1, "i16": 2, "u16": 2, "i24": 3, "u24": 3, "i32": 4, "u32": 4,
    "i64": 8, "u64": 8, "f32": 4, "f64": 8,
}  # fmt: skip
"""Numbers of a packed layout, and the bytes of each."""

NumberType = Literal[
    "i8", "u8", "i16", "u16", "i24", "u24", "i32", "u32", "i64", "u64", "f32", "f64"
]
CHECKSUM_BYTES = {
    "none": 0, "sum8": 1, "xor8": 1, "crc16-modbus": 2, "crc16-ccitt": 2, "crc32": 4,
}  # fmt: skip
"""Checksums of a packed layout, and the bytes of each; they follow the samples."""

Checksum = Literal["none", "sum8", "xor8", "crc16-modbus", "crc16-ccitt", "crc32"]
TimeUnit = Literal["s", "ms", "us", "ns"]
PLACE = "Dotted path (json), number from 0 or name of a column (csv); packed goes by order."
Place = Annotated[PlainText | int | None, Field(description=PLACE)]


class Channel(Frozen):
    """One channel: value = sign * scale * (number - offset), in `unit`.

    Examples
    --------
    >>> Channel(name="z", scale=3.9e-6, unit="g").factor
    3.9e-06
    """

    name: Annotated[PlainText, Field(min_length=1, max_length=200)]
    unit: Annotated[UnitName, Plain] = "m/s^2"
    at: Place = None
    """Where it is in a message; None for under its name, or, in csv, by order."""
    scale: FiniteFloat = 1.0
    """Units for one count: 1 / sensitivity."""
    offset: FiniteFloat = 0.0
    """Counts that mean zero."""
    sign: Literal[1, -1] = 1
    """-1 for an axis that is mounted the other way round."""
    topic: PlainText | None = None
    """Where each channel has a topic of its own; None for one topic for all."""

    @property
    def factor(self) -> float:
        """Factor from counts to the unit: sign times scale."""
        return self.sign * self.scale


class CounterField(Frozen):
    """A number that the device counts up, by which each lost sample is noticed."""

    at: Place = None
    bits: Annotated[int, Field(ge=4, le=64)] = 64
    """Its width: an 8-bit counter runs from 255 to 0. 64 for one that never wraps."""
    counts: Literal["samples", "messages"] = "samples"
    """What it counts. Of a message of many samples it is the number of the first."""


class Stamp(Frozen):
    """The device's own time of a sample."""

    at: Place = None
    unit: TimeUnit = "us"
    clock: Literal["utc", "device"] = "device"
    """`utc` counts from 1970-01-01 UTC and is kept by NTP, PTP or GPS; `device` runs freely,
    from anywhere: its rate and offset are estimated."""
    bits: Annotated[int, Field(ge=16, le=64)] = 64
    """Its width, where it wraps, as 32-bit microseconds do every 71.6 minutes."""
    of: Literal["first", "last"] = "first"
    """Which sample of a message of many it belongs to."""


class _FieldLayout(Frozen):
    """Fields that all layouts share."""

    channels: Annotated[tuple[Channel, ...], Field(min_length=1, max_length=4096)]
    counter: CounterField | None = None
    stamp: Stamp | None = None

    @model_validator(mode="after")
    def _names_differ(self) -> "_FieldLayout":
        names = Tally(channel.name for channel in self.channels)
        twice = sorted(name for name, count in names.items() if count > 1)
        if twice:
            raise ValueError(f"{twice} name more than one channel. Give each its own name.")
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels, in order."""
        return tuple(channel.name for channel in self.channels)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the channels, in order."""
        return tuple(channel.unit for channel in self.channels)


class JsonLayout(_FieldLayout):
    """A JSON object a message or a line; a value is one sample, an array a block of them."""

    kind: Literal["json"] = "json"
    rows: PlainText | None = None
    """Dotted path to an array of rows, one row a sample with the channels in order."""

    @model_validator(mode="after")
    def _has_paths(self) -> "JsonLayout":
        for what, part in (("counter", self.counter), ("stamp", self.stamp)):
            if part is not None and not isinstance(part.at, str):
                raise ValueError(
                    f"{what}.at={part.at!r} is not a valid path. Give one, such as 'n'."
                )
        return self


class CsvLayout(_FieldLayout):
    """A line of text a sample: numbers between delimiters."""

    kind: Literal["csv"] = "csv"
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] = ","
    columns: tuple[PlainText, ...] | None = None
    """Names of the columns in order; None where channels, counter and stamp give numbers, or
    are the columns in that order: counter, stamp, channels."""

    def column(self, place: str | int | None, otherwise: int | str) -> int:
        """Find a column by number from 0, by name, or where it would be otherwise."""
        place = otherwise if place is None else place
        if isinstance(place, str) and self.columns and place in self.columns:
            return self.columns.index(place)
        if isinstance(place, str) and place.isdigit():
            place = int(place)
        if isinstance(place, int) and place >= 0:
            return place
        raise ValueError(
            f"No column is called {place!r}. Allowed: numbers from 0, or a name of "
            f"`columns`={self.columns}."
        )

    @property
    def places(self) -> tuple[int | None, int | None, tuple[int, ...]]:
        """Columns of counter, stamp and channels."""
        begin = int(self.counter is not None) + int(self.stamp is not None)
        counter = None if self.counter is None else self.column(self.counter.at, 0)
        stamp = None if self.stamp is None else self.column(self.stamp.at, begin - 1)
        channels = tuple(
            self.column(
                channel.at,
                channel.name if self.columns and channel.name in self.columns else begin + n,
            )
            for n, channel in enumerate(self.channels)
        )
        return counter, stamp, channels

    @model_validator(mode="after")
    def _has_columns(self) -> "CsvLayout":
        counter, stamp, channels = self.places
        used = [place for place in (counter, stamp, *channels) if place is not None]
        if len(set(used)) < len(used):
            raise ValueError(f"Columns {used} are used twice. Give each part its own.")
        return self


class PackedLayout(_FieldLayout):
    """Binary frames: [sync] [header] samples [checksum].

    The checksum is over header and samples, in the byte order of the frame.
    """

    kind: Literal["packed"] = "packed"
    byte_order: Literal["little", "big"] = "little"
    sync: Annotated[str, Field(pattern=r"^([0-9a-fA-F]{2}){0,16}$")] = ""
    """Bytes that each frame begins with, in hexadecimal, such as `a55a`; a byte stream needs
    them to find a frame again after garbage."""
    header: Annotated[
        tuple[
            Annotated[
                str, Field(pattern=r"^(counter|stamp|samples|skip):([iuf](8|16|24|32|64)|\d+)$")
            ],
            ...,
        ],
        Field(max_length=64),
    ] = ()
    """What stands before the samples: `counter:u16`, `stamp:u32`, `samples:u8` (how many there
    are), `skip:3` (three bytes of no interest)."""
    type: NumberType = "i16"
    """Of each number of the samples."""
    samples: Annotated[int, Field(ge=1, le=1_000_000)] | None = None
    """How many a frame has; None for as many as the header says, or as fit a message."""
    planar: bool = False
    """Whether all samples of a channel stand together, instead of all channels of a sample."""
    checksum: Checksum = "none"

    MOST_BYTES: ClassVar[int] = 2**22

    @property
    def fields(self) -> tuple[tuple[str, str, int], ...]:
        """Parts of the header: meaning, type, bytes."""
        parts = (part.split(":") for part in self.header)
        return tuple(
            (what, kind, int(kind) if what == "skip" else NUMBERS[kind]) for what, kind in parts
        )

    @property
    def sync_bytes(self) -> bytes:
        """Bytes that each frame begins with."""
        return bytes.fromhex(self.sync)

    @property
    def begin_bytes(self) -> int:
        """Length of sync and header."""
        return len(self.sync_bytes) + sum(size for _, _, size in self.fields)

    @property
    def sample_bytes(self) -> int:
        """Length of one sample of all channels."""
        return NUMBERS[self.type] * len(self.channels)

    def frame_bytes(self, samples: int) -> int:
        """Length of a frame of so many samples."""
        end = CHECKSUM_BYTES[self.checksum]
        return self.begin_bytes + samples * self.sample_bytes + end

    @model_validator(mode="after")
    def _header_agrees(self) -> "PackedLayout":
        said = [what for what, kind, _ in self.fields if what != "skip"]
        for what, kind, _ in self.fields:
            if what != "skip" and kind not in NUMBERS:
                raise ValueError(
                    f"{what}:{kind} is not a number. Allowed: {', '.join(NUMBERS)}."
                )
        for what, part in (("counter", self.counter), ("stamp", self.stamp)):
            if (part is not None) != (what in said):
                raise ValueError(
                    f"`{what}` and the header disagree. Give `{what}`, and its type in the "
                    f"header, such as '{what}:u32'."
                )
        if len(set(said)) < len(said):
            raise ValueError(f"The header {list(self.header)} has a part twice.")
        if self.frame_bytes(self.samples or 1) > self.MOST_BYTES:
            raise ValueError(
                f"A frame of {self.frame_bytes(self.samples or 1):,} bytes. Allowed: up to "
                f"{self.MOST_BYTES:,}."
            )
        return self


Layout = Annotated[JsonLayout | CsvLayout | PackedLayout, Field(discriminator="kind")]
_LAYOUT: TypeAdapter[JsonLayout | CsvLayout | PackedLayout] = TypeAdapter(Layout)


def read_layout(path: Path) -> JsonLayout | CsvLayout | PackedLayout:
    """Read a layout from a TOML or JSON file.

    Raises
    ------
    ValueError
        Where there is no such file, or it holds no layout.
    """
    try:
        table = read_settings_file(path)
    except OSError as error:
        raise ValueError(
            f"The layout {path} cannot be read: {error.strerror}. Give an existing file, or "
            "one of the words json, csv, packed."
        ) from error
    except DocumentError as error:
        raise ValueError(f"The layout {path}: {error}") from error
    try:
        return _LAYOUT.validate_python(table)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in fault["loc"])
        raise ValueError(f"The layout {path}: {where}: {fault['msg']}.") from error


STRUCT_CODES = {
    "i8": "b", "u8": "B", "i16": "h", "u16": "H", "i32": "i", "u32": "I",
    "i64": "q", "u64": "Q", "f32": "f", "f64": "d",
}  # fmt: skip


def read_number(kind: str, order: Literal["little", "big"], data: bytes) -> int | float:
    """Read one number of a packed layout.

    Examples
    --------
    >>> read_number("i24", "big", bytes.fromhex("fffffe"))
    -2
    """
    if kind in ("i24", "u24"):
        return int.from_bytes(data, order, signed=kind == "i24")
    number: int | float = struct.unpack(
        ("<" if order == "little" else ">") + STRUCT_CODES[kind], data
    )[0]
    return number

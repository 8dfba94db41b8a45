"""Recordings in MCAP: accelerations of inertial units, of ROS 2 (CDR) and in JSON."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from slowtime_services.documents.json_documents import read_json
from slowtime_services.files.record import RecordError
from slowtime_services.record.chunks import Unpacking

from .found import Found, Series
from .inertial_json import Field, stamp_of, vectors_of

MOST_SCHEMA_BYTES = 1 << 16
"""Size of the definition of a message [bytes]. Those that are read have 2,000, with all that
they refer to; the library takes 0.1 ms for each of their lines."""

IMU, ACCEL = "sensor_msgs/msg/Imu", "geometry_msgs/msg/AccelStamped"
_ANGULAR = ("angular_velocity", "rad/s")
_FIELDS = {
    IMU: (("linear_acceleration", "m/s^2"), _ANGULAR),
    ACCEL: (("accel.linear", "m/s^2"),),
}
"""Of each message, fields with x, y and z, and their unit (REP 103)."""


class _Topic:
    """Messages read of one topic."""

    def __init__(self) -> None:
        self.logged: list[int] = []
        self.stamps: list[int] = []
        self.rows: list[list[float]] = []
        self.titles: list[tuple[str, str]] = []

    def take(self, logged: int, stamp: int, fields: list[Field]) -> None:
        """Take a message, logged at a time [ns], with the fields of those before it."""
        titles = [
            (f"{name.rpartition('.')[2]}.{axis}", unit)
            for name, unit, _ in fields
            for axis in "xyz"
        ]
        if not self.rows:
            self.titles = titles
        if titles == self.titles:
            self.logged.append(logged)
            self.stamps.append(stamp)
            self.rows.append([value for _, _, vector in fields for value in vector])


def read(path: Path, max_bytes: int) -> Found:
    """Return the accelerations of each topic, with the stamps of their headers."""
    topics: dict[str, _Topic] = {}
    seen: dict[str, str] = {}
    decode = _Decoders(path)
    for schema, channel, message in _messages(path):
        kind = schema.name if schema is not None else channel.message_encoding
        seen[channel.topic] = kind
        told = decode(channel.message_encoding, kind, schema, message)
        if told is not None and told[1]:
            topic = topics.setdefault(channel.topic, _Topic())
            topic.take(message.log_time, told[0] or message.log_time, told[1])
    if not topics:
        found = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(seen.items())[:8])
        raise RecordError(
            f"{path.name} has no vibration in it: topics found: {found or 'none'}. Give a "
            f"recording with {IMU}, {ACCEL} or accelerations in JSON, or one made by `slowtime "
            "record` or `slowtime import`."
        )
    series: list[Series] = []
    for name, one in topics.items():
        prefix = f"{name.strip('/')}." if len(topics) > 1 else ""
        order = np.argsort(one.logged, kind="stable")
        series.append(Series(f"{prefix}stamp", np.array(one.stamps)[order], stamps=True))
        for (title, unit), values in zip(one.titles, np.array(one.rows)[order].T, strict=True):
            if np.ptp(values) or unit != _ANGULAR[1]:
                series.append(Series(prefix + title, values, unit))
    return Found(series)


def _messages(path: Path) -> Iterator[tuple[Schema | None, Channel, Message]]:
    """Yield the messages in the order of the file, each chunk unpacked within a bound."""
    unpacking = Unpacking(path.stat().st_size)
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    with path.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            within = [record]
            if isinstance(record, Chunk):
                within = breakup_chunk(unpacking.plain(record))
            for one in within:
                if isinstance(one, Schema):
                    schemas[one.id] = one
                elif isinstance(one, Channel):
                    channels[one.id] = one
                elif isinstance(one, Message):
                    channel = channels[one.channel_id]
                    yield schemas.get(channel.schema_id), channel, one


class _Decoders:
    """Decode stamp and vectors of a message by its encoding; None for other types."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._factory: Any = None
        self._cdr: dict[int, Callable[[bytes], Any]] = {}

    def __call__(
        self, encoding: str, kind: str, schema: Any, message: Any
    ) -> tuple[int | None, list[Field]] | None:
        if encoding == "json":
            body = read_json(message.data)
            return stamp_of(body), vectors_of(body)
        if kind not in _FIELDS or schema is None:
            return None
        if schema.id not in self._cdr:
            if len(schema.data) > MOST_SCHEMA_BYTES:
                raise RecordError(
                    f"{self._path.name} defines {kind} in {len(schema.data):,} bytes. Allowed: "
                    f"{MOST_SCHEMA_BYTES:,}. It is damaged, or was made to. Record it again."
                )
            self._factory = self._factory or _decoder(self._path)()
            decoder = self._factory.decoder_for(encoding, schema)
            if decoder is None:
                return None
            self._cdr[schema.id] = decoder
        told = self._cdr[schema.id](message.data)
        at = told.header.stamp
        return at.sec * 10**9 + at.nanosec, list(_fields(told, kind))


def _decoder(path: Path) -> Any:
    try:
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        raise RecordError(
            f"{path.name} is a recording of ROS 2, which mcap-ros2-support reads. Install it: "
            "pip install 'slowtime[formats]' or pip install mcap-ros2-support."
        ) from None
    return DecoderFactory


def _fields(told: Any, kind: str) -> Iterator[Field]:
    for field, unit in _FIELDS[kind]:
        vector = told
        for part in field.split("."):
            vector = getattr(vector, part)
        yield field, unit, (float(vector.x), float(vector.y), float(vector.z))

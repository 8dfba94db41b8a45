"""Recordings of ROS 2 in MCAP: accelerations of inertial units, by mcap-ros2-support."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader

from slowtime_services.files.record import RecordError

from .found import Found, Series

IMU, ACCEL = "sensor_msgs/msg/Imu", "geometry_msgs/msg/AccelStamped"
_ANGULAR = ("angular_velocity", "rad/s")
_FIELDS = {
    IMU: (("linear_acceleration", "m/s^2"), _ANGULAR),
    ACCEL: (("accel.linear", "m/s^2"),),
}
"""Of each message, fields with x, y and z, and their unit (REP 103)."""


def read(path: Path, max_bytes: int) -> Found:
    """Give the accelerations of each topic, with the stamps of their headers."""
    rows: dict[str, list[tuple[float, ...]]] = {}
    kinds: dict[str, str] = {}
    stamps: dict[str, list[int]] = {}
    topics: set[str] = set()
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
        if summary is not None:
            topics = {channel.topic for channel in summary.channels.values()}
            schemas = {one.name for one in summary.schemas.values()}
            if not schemas & _FIELDS.keys():
                raise RecordError(
                    f"{path.name} is a recording without {IMU} or {ACCEL}; it has "
                    f"{', '.join(sorted(schemas)[:6]) or 'no messages'}. What slowtime "
                    "recorded is read with `slowtime replay`."
                )
        reader = make_reader(file, decoder_factories=[_decoder(path)()])
        for schema, channel, message, told in reader.iter_decoded_messages():
            if schema is None or schema.name not in _FIELDS:
                continue
            topic = channel.topic
            kinds[topic] = schema.name
            at = told.header.stamp
            stamp = at.sec * 10**9 + at.nanosec
            stamps.setdefault(topic, []).append(stamp or message.log_time)
            rows.setdefault(topic, []).append(tuple(_numbers(told, schema.name)))
    if not rows:
        raise RecordError(
            f"{path.name} holds no {IMU} or {ACCEL}. Topics: {', '.join(sorted(topics)[:8])}."
        )
    series: list[Series] = []
    for topic, found in rows.items():
        prefix = f"{topic.strip('/')}." if len(rows) > 1 else ""
        series.append(Series(f"{prefix}stamp", np.array(stamps[topic]), stamps=True))
        for name, unit, values in zip(*_titles(kinds[topic]), np.array(found).T, strict=True):
            if np.ptp(values) or unit != _ANGULAR[1]:
                series.append(Series(prefix + name, values, unit))
    return Found(series)


def _decoder(path: Path) -> Any:
    try:
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        raise RecordError(
            f"{path.name} is a recording of ROS 2, which mcap-ros2-support reads. Install it: "
            "pip install 'slowtime[formats]' or pip install mcap-ros2-support."
        ) from None
    return DecoderFactory


def _titles(kind: str) -> tuple[list[str], list[str]]:
    names = [
        f"{field.rpartition('.')[2]}.{axis}" for field, _ in _FIELDS[kind] for axis in "xyz"
    ]
    return names, [unit for _, unit in _FIELDS[kind] for _ in "xyz"]


def _numbers(told: Any, kind: str) -> Iterator[float]:
    for field, _ in _FIELDS[kind]:
        vector = told
        for part in field.split("."):
            vector = getattr(vector, part)
        yield from (float(vector.x), float(vector.y), float(vector.z))

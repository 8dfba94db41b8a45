"""Messages of inertial units in JSON, as Foxglove and bridges of ROS write them."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

MAX_DEPTH = 6
"""Levels of a message that are looked at [1]."""
_ACCELERATION = re.compile(r"linear_?acc|accel|(?<![a-z])acc(?![a-z])", re.I)
_ANGULAR = re.compile(r"angular_?vel|gyro|(?<![a-z])rate(?![a-z])", re.I)
_IN_SI = re.compile(r"linear_?acceleration|angular_?velocity", re.I)
"""Fields of sensor_msgs and geometry_msgs, which are in SI by REP 103 whatever carries them."""
_STAMPS = ("header.stamp", "timestamp", "stamp", "time")

Vector = tuple[float, float, float]
Field = tuple[str, str, Vector]
"""Name of a vector, its unit where it is known, and its components."""


def vectors_of(message: Any) -> list[Field]:
    """Find accelerations and angular rates: objects with x, y and z under such a name."""
    return list(_vectors(message, "", 0))


def _vectors(value: Any, name: str, depth: int) -> Iterator[Field]:
    if not isinstance(value, Mapping) or depth > MAX_DEPTH:
        return
    vector = _vector(value)
    if vector is not None:
        angular = bool(_ANGULAR.search(name))
        if angular or _ACCELERATION.search(name):
            known = bool(_IN_SI.search(name))
            yield name, ("rad/s" if angular else "m/s^2") if known else "", vector
        return
    for key, inner in value.items():
        yield from _vectors(inner, f"{name}.{key}" if name else str(key), depth + 1)


def _vector(value: Mapping[str, Any]) -> Vector | None:
    parts = [value.get(axis) for axis in "xyz"]
    if any(isinstance(part, bool) or not isinstance(part, int | float) for part in parts):
        return None
    x, y, z = (float(part) for part in parts if part is not None)
    return x, y, z


def stamp_of(message: Any) -> int | None:
    """Read the time of a message [ns since 1970]; None where it states none.

    Examples
    --------
    >>> stamp_of({"timestamp": {"sec": 2, "nsec": 5}})
    2000000005
    """
    for path in _STAMPS:
        value = message
        for key in path.split("."):
            value = value.get(key) if isinstance(value, Mapping) else None
        if isinstance(value, Mapping):
            seconds = value.get("sec", value.get("secs"))
            rest = value.get("nsec", value.get("nanosec", value.get("nsecs", 0)))
            if type(seconds) is int and type(rest) is int and 0 <= rest < 10**9:
                return seconds * 10**9 + rest if 0 < seconds < 2**33 else None
        elif isinstance(value, str):
            return _of_text(value)
    return None


def _of_text(text: str) -> int | None:
    try:
        return int(np.datetime64(text.removesuffix("Z"), "ns").astype(np.int64))
    except ValueError:
        return None

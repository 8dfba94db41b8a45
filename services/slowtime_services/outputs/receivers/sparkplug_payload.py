"""Payloads of Sparkplug B: the fields used of the message that the specification defines.

References
----------
Eclipse Foundation, "Sparkplug Specification" 3.0.0, section 6.4: numbers of fields and types.
"""

import functools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from slowtime_services.outputs.batch import NotSentError

Value = float | int | bool | str | None

INT64, UINT64, DOUBLE, BOOLEAN, STRING = 4, 8, 10, 11, 12
"""Numbers of data types."""

_FIELD_OF = {
    INT64: "long_value",
    UINT64: "long_value",
    DOUBLE: "double_value",
    BOOLEAN: "boolean_value",
    STRING: "string_value",
}
_MS = 1_000_000
"""Nanoseconds of a millisecond, the unit of stamps of Sparkplug."""


class Metric(NamedTuple):
    """A named value.

    Parameters
    ----------
    value
        None where there is none: the metric is null.
    t_ns
        Of the value [ns since 1970-01-01 UTC].
    properties
        Such as ``{"engUnit": "Hz"}``, sent with a birth.
    """

    name: str
    datatype: int
    value: Value
    t_ns: int
    is_historical: bool = False
    properties: Mapping[str, str | float] = {}


def encode(metrics: Sequence[Metric], t_ns: int, sequence: int | None) -> bytes:
    """Write a payload.

    Parameters
    ----------
    t_ns
        Time of sending [ns since 1970-01-01 UTC].
    sequence
        From 0 to 255; None for a death of the node, which has none.
    """
    payload = _message()()
    payload.timestamp = t_ns // _MS
    if sequence is not None:
        payload.seq = sequence
    for metric in metrics:
        _fill(payload.metrics.add(), metric)
    return bytes(payload.SerializeToString())


def commands(payload: bytes) -> dict[str, bool]:
    """Return the Boolean metrics of a command by their names.

    Raises
    ------
    ValueError
        Where it is no payload.
    """
    from google.protobuf.message import DecodeError

    read = _message()()
    try:
        read.ParseFromString(payload)
    except DecodeError as error:
        raise ValueError("The command is no payload of Sparkplug B.") from error
    return {one.name: one.boolean_value for one in read.metrics}


def _fill(told: Any, metric: Metric) -> None:
    told.name = metric.name
    told.timestamp = metric.t_ns // _MS
    told.datatype = metric.datatype
    if metric.is_historical:
        told.is_historical = True
    if metric.value is None:
        told.is_null = True
    else:
        setattr(told, _FIELD_OF[metric.datatype], metric.value)
    for name, value in metric.properties.items():
        told.properties.keys.append(name)
        stated = told.properties.values.add()
        if isinstance(value, str):
            stated.type, stated.string_value = STRING, value
        else:
            stated.type, stated.double_value = DOUBLE, value


_LAYOUT: Mapping[str, tuple[tuple[int, str, str, bool], ...]] = {
    "Payload": (
        (1, "timestamp", "UINT64", False),
        (2, "metrics", "Metric", True),
        (3, "seq", "UINT64", False),
    ),
    "Metric": (
        (1, "name", "STRING", False),
        (2, "alias", "UINT64", False),
        (3, "timestamp", "UINT64", False),
        (4, "datatype", "UINT32", False),
        (5, "is_historical", "BOOL", False),
        (7, "is_null", "BOOL", False),
        (9, "properties", "PropertySet", False),
        (10, "int_value", "UINT32", False),
        (11, "long_value", "UINT64", False),
        (12, "float_value", "FLOAT", False),
        (13, "double_value", "DOUBLE", False),
        (14, "boolean_value", "BOOL", False),
        (15, "string_value", "STRING", False),
    ),
    "PropertySet": ((1, "keys", "STRING", True), (2, "values", "PropertyValue", True)),
    "PropertyValue": (
        (1, "type", "UINT32", False),
        (2, "is_null", "BOOL", False),
        (6, "double_value", "DOUBLE", False),
        (8, "string_value", "STRING", False),
    ),
}
"""Message → number, name, type of each field, and whether it is repeated."""


@functools.cache
def _message() -> Any:
    """Make the class of a payload, in a pool of its own, so that no other copy collides."""
    try:
        from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    except ImportError as error:
        raise NotSentError(
            "An output by Sparkplug needs protobuf. Install it: pip install "
            "'slowtime[sparkplug]'."
        ) from error
    file = descriptor_pb2.FileDescriptorProto(
        name="sparkplug.proto", package="sparkplug", syntax="proto2"
    )
    for name, fields in _LAYOUT.items():
        message = file.message_type.add(name=name)
        for number, field, kind, is_repeated in fields:
            made = message.field.add(number=number, name=field, label=3 if is_repeated else 1)
            if kind in _LAYOUT:
                made.type, made.type_name = made.TYPE_MESSAGE, f".sparkplug.{kind}"
            else:
                made.type = getattr(made, f"TYPE_{kind}")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("sparkplug.Payload"))


def check_installed() -> None:
    """Raise `NotSentError` where protobuf is not installed."""
    _message()

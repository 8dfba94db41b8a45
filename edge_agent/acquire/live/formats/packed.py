"""Decodes binary frames and verifies their checksums."""

import binascii
import functools

import numpy as np

from edge_agent.acquire.live.batch import Batch, GarbledError
from edge_agent.layouts import CHECKSUM_BYTES, PackedLayout, read_number


def decode_frame(layout: PackedLayout, data: bytes, arrival_ns: int) -> Batch:
    """Read the samples of one frame, checked.

    Raises `GarbledError` where sync, length or checksum are not what the layout declares.
    """
    if not data.startswith(layout.sync_bytes) or len(data) < layout.begin_bytes:
        raise GarbledError("It does not begin like a frame.")
    header = read_header(layout, data)
    end = len(data) - CHECKSUM_BYTES[layout.checksum]
    body = data[layout.begin_bytes : end]
    count = samples_of(layout, header)
    if count is None:
        count = len(body) // layout.sample_bytes
    if count < 1 or len(body) != count * layout.sample_bytes:
        raise GarbledError(f"{len(body)} bytes of samples; {layout.sample_bytes} make one.")
    if not is_sound(layout, data):
        raise GarbledError("Its checksum is wrong.")
    values = numbers(layout, body)
    columns = len(layout.channels)
    shaped = (
        values.reshape(columns, count).T if layout.planar else values.reshape(count, columns)
    )
    last = layout.stamp is not None and layout.stamp.of == "last"
    return Batch(
        shaped,
        arrival_ns,
        _integer(header.get("counter")),
        _integer(header.get("stamp")),
        count - 1 if last else 0,
    )


def read_header(layout: PackedLayout, data: bytes) -> dict[str, int | float]:
    """Return the numbers of the header by their meaning."""
    place, header = len(layout.sync_bytes), {}
    for what, kind, size in layout.fields:
        if what != "skip":
            header[what] = read_number(kind, layout.byte_order, data[place : place + size])
        place += size
    return header


def samples_of(layout: PackedLayout, header: dict[str, int | float]) -> int | None:
    """Return the number of samples of a frame; None if only its length determines it."""
    return _integer(header.get("samples")) if "samples" in header else layout.samples


def is_sound(layout: PackedLayout, frame: bytes) -> bool:
    """Whether the checksum at the end is that of header and samples."""
    size = CHECKSUM_BYTES[layout.checksum]
    if not size:
        return True
    covered, given = frame[len(layout.sync_bytes) : -size], frame[-size:]
    return checksum(layout.checksum, covered).to_bytes(size, layout.byte_order) == given


def checksum(kind: str, data: bytes) -> int:
    """Checksum of `data`.

    Examples
    --------
    >>> [hex(checksum(kind, b"123456789")) for kind in ("crc16-modbus", "crc16-ccitt", "crc32")]
    ['0x4b37', '0x29b1', '0xcbf43926']
    """
    if kind == "sum8":
        return sum(data) & 0xFF
    if kind == "xor8":
        return functools.reduce(lambda one, other: one ^ other, data, 0)
    if kind == "crc16-ccitt":
        return binascii.crc_hqx(data, 0xFFFF)
    if kind == "crc32":
        return binascii.crc32(data)
    value, table = 0xFFFF, _modbus_table()
    for byte in data:
        value = (value >> 8) ^ table[(value ^ byte) & 0xFF]
    return value


@functools.cache
def _modbus_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        for _ in range(8):
            byte = (byte >> 1) ^ (0xA001 if byte & 1 else 0)
        table.append(byte)
    return tuple(table)


def numbers(layout: PackedLayout, body: bytes) -> np.ndarray:
    """Read all numbers of the samples, as 64-bit floats."""
    order = "<" if layout.byte_order == "little" else ">"
    if layout.type in ("i24", "u24"):
        raw = np.frombuffer(body, np.uint8).reshape(-1, 3).astype(np.int64)
        low, middle, high = (raw[:, n] for n in ((0, 1, 2) if order == "<" else (2, 1, 0)))
        value = low | middle << 8 | high << 16
        if layout.type == "i24":
            value -= (value & 0x800000) << 1
        return value.astype(np.float64)
    kind = np.dtype(f"{order}{layout.type[0]}{int(layout.type[1:]) // 8}")
    return np.frombuffer(body, kind).astype(np.float64)


def _integer(value: int | float | None) -> int | None:
    if value is None:
        return None
    if value != value or abs(value) == float("inf"):
        raise GarbledError(f"{value} is not a whole number.")
    return int(value)

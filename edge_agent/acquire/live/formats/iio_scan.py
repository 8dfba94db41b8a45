"""The packing of scans of Linux industrial I/O, by the type strings of their elements.

``le:s20/32>>4`` is little-endian, signed, 20 bits in 32, after a shift to the right by 4.
"""

import re
from typing import NamedTuple

import numpy as np

from edge_agent.acquire.live.batch import Batch

TYPE = re.compile(r"^(be|le):([su])(\d+)/(8|16|32|64)(?:X(\d+))?>>(\d+)$")


class Element(NamedTuple):
    """One element of a scan."""

    name: str
    order: str
    is_signed: bool
    bits: int
    size: int
    shift: int


class Scan(NamedTuple):
    """All enabled elements in the order of a scan, and where each begins."""

    elements: tuple[Element, ...]
    offsets: tuple[int, ...]
    size: int


def element_of(name: str, text: str) -> Element:
    """Read a type string.

    Examples
    --------
    >>> element_of("accel_x", "be:s20/32>>12")[1:]
    ('>', True, 20, 4, 12)
    """
    found = TYPE.match(text.strip())
    if found is None:
        raise ValueError(f"{name} has the type {text!r}. Allowed are such as le:s16/16>>0.")
    order, sign, bits, storage, repeat, shift = found.groups()
    if int(repeat or 1) > 1 or int(bits) + int(shift) > int(storage):
        raise ValueError(f"{name} has the type {text!r}, which is not supported.")
    return Element(
        name,
        ">" if order == "be" else "<",
        sign == "s",
        int(bits),
        int(storage) // 8,
        int(shift),
    )


def scan_of(elements: tuple[Element, ...]) -> Scan:
    """Place elements as the kernel does: each at a multiple of its size.

    Examples
    --------
    >>> kinds = ("le:s16/16>>0", "le:s16/16>>0", "le:s16/16>>0", "le:s64/64>>0")
    >>> scan_of(tuple(element_of(f"e{n}", kind) for n, kind in enumerate(kinds)))[1:]
    ((0, 2, 4, 8), 16)
    """
    place, offsets = 0, []
    for element in elements:
        place = -(-place // element.size) * element.size
        offsets.append(place)
        place += element.size
    largest = max(element.size for element in elements)
    return Scan(elements, tuple(offsets), -(-place // largest) * largest)


def values_of(scan: Scan, data: bytes) -> dict[str, np.ndarray]:
    """Numbers of each element, out of whole scans."""
    raw = np.frombuffer(data, np.uint8).reshape(-1, scan.size)
    values = {}
    for element, offset in zip(scan.elements, scan.offsets, strict=True):
        part = np.ascontiguousarray(raw[:, offset : offset + element.size])
        number = part.view(f"{element.order}u{element.size}")[:, 0].astype(np.uint64)
        number = (number >> np.uint64(element.shift)) << np.uint64(64 - element.bits)
        signed = number.view(np.int64) >> np.int64(64 - element.bits)
        unsigned = number >> np.uint64(64 - element.bits)
        values[element.name] = signed if element.is_signed else unsigned
    return values


def batches_of(
    scan: Scan, channels: tuple[str, ...], data: bytes, arrival_ns: int
) -> list[Batch]:
    """Turn whole scans into batches: one, or one a scan where they are stamped."""
    values = values_of(scan, data)
    rows = np.stack([values[name].astype(np.float64) for name in channels], axis=1)
    if "timestamp" not in values:
        return [Batch(rows, arrival_ns)]
    stamps = values["timestamp"].tolist()
    return [Batch(rows[n : n + 1], arrival_ns, None, stamp) for n, stamp in enumerate(stamps)]

"""The raw block: a JSON header and the samples as they are, in one binary message.

Layout, little-endian: the four bytes ``STB1``, the header's length as an unsigned 32-bit
integer, the header (UTF-8 JSON, `RawHeader`), then the samples row by row (time, channel).
"""

import struct

from pydantic import ValidationError
from pydantic_core import from_json, to_json

from .migrations import UnknownVersionError, migrate
from .raw_header import ITEM_BYTES as ITEM_BYTES
from .raw_header import ClockCorrection as ClockCorrection
from .raw_header import RawHeader as RawHeader

MAGIC = b"STB1"


def encode_raw(header: RawHeader, body: bytes) -> bytes:
    """Header and samples as one payload."""
    if len(body) != header.body_bytes:
        raise ValueError(
            f"The header promises {header.body_bytes} bytes of samples, {len(body)} were given."
        )
    text = header.model_dump_json(exclude_defaults=False).encode()
    return b"".join((MAGIC, struct.pack("<I", len(text)), text, body))


def decode_raw(payload: bytes) -> tuple[RawHeader, memoryview]:
    """Header and samples of a payload; the samples are a view, not a copy.

    Raises
    ------
    ValueError
        Where the payload is not a raw block, is cut short, or has bytes left over.
    """
    if payload[:4] != MAGIC or len(payload) < 8:
        raise ValueError(
            f"Not a raw block: it begins with {bytes(payload[:4])!r}, a raw block with "
            f"{MAGIC!r}."
        )
    (length,) = struct.unpack_from("<I", payload, 4)
    if 8 + length > len(payload):
        raise ValueError(
            f"A raw block cut short: header of {length} bytes, {len(payload) - 8} present."
        )
    header = _header(payload[8 : 8 + length])
    body = memoryview(payload)[8 + length :]
    if len(body) != header.body_bytes:
        raise ValueError(
            f"A raw block whose header promises {header.body_bytes} bytes of samples and that "
            f"carries {len(body)}."
        )
    return header, body


def _header(text: bytes) -> RawHeader:
    try:
        return RawHeader.model_validate_json(text, strict=True)
    except ValidationError as error:
        try:
            content = migrate(RawHeader.MESSAGE, from_json(text, allow_inf_nan=False))
            return RawHeader.model_validate_json(to_json(content), strict=True)
        except (UnknownVersionError, ValidationError, ValueError, AttributeError):
            raise ValueError(f"A raw block with an unreadable header: {error}") from error

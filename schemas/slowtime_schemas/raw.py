"""The raw block: a JSON header and the samples as they are, in one binary message.

Layout, little-endian: the four bytes ``STB1``, the header's length as an unsigned 32-bit
integer, the header (UTF-8 JSON, `RawHeader`), then the samples row by row (time, channel).
"""

import struct
from typing import Annotated, ClassVar, Literal

from pydantic import Field, PositiveFloat, ValidationError, model_validator

from .messages import Message, TimeBase
from .quantities import Count, Covariates, Finite, UnitName

MAGIC = b"STB1"
ITEM_BYTES = {"<f8": 8, "<f4": 4, "<i4": 4, "<i2": 2}
DType = Literal["<f8", "<f4", "<i4", "<i2"]


class RawHeader(Message):
    """What a raw block says of its samples; `t_ns` is the first sample's time."""

    MESSAGE: ClassVar[str] = "raw"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    time_base: TimeBase = "live"
    rate_hz: Annotated[PositiveFloat, Field(allow_inf_nan=False)]
    first_index: Count
    dtype: DType
    samples: Annotated[int, Field(ge=0, lt=2**40, description="Rows.")]
    channels: Annotated[tuple[str, ...], Field(min_length=1, max_length=4096)]
    units: Annotated[tuple[str, ...], Field(min_length=1, max_length=4096)]
    epoch: Count | None = None
    slow_time: Finite | None = None
    slow_time_unit: UnitName = "s"
    covariates: Covariates = Field(default_factory=dict)
    truth: Covariates | None = None

    @model_validator(mode="after")
    def _one_unit_per_channel(self) -> "RawHeader":
        if len(self.units) != len(self.channels):
            raise ValueError(
                f"{len(self.channels)} channels but {len(self.units)} units. Give one unit "
                "per channel."
            )
        return self

    @property
    def body_bytes(self) -> int:
        """Length of the samples that must follow the header."""
        return self.samples * len(self.channels) * ITEM_BYTES[self.dtype]


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
    try:
        header = RawHeader.model_validate_json(payload[8 : 8 + length], strict=True)
    except ValidationError as error:
        raise ValueError(f"A raw block with an unreadable header: {error}") from error
    body = memoryview(payload)[8 + length :]
    if len(body) != header.body_bytes:
        raise ValueError(
            f"A raw block whose header promises {header.body_bytes} bytes of samples and that "
            f"carries {len(body)}."
        )
    return header, body

"""Scan of an MCAP file for records and damaged bytes.

Behind damage the next record is looked for: a chunk tells itself by its lengths, which must
agree; other records by several of them that follow one another.
"""

import mmap
import struct
from collections.abc import Iterator
from typing import NamedTuple

from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

HEAD = struct.Struct("<BQ")
"""Opcode and length of a record."""
CHUNK_HEAD = struct.Struct("<QQQI")
"""First and last time, unpacked size and checksum of a chunk."""
COMPRESSIONS = (b"", b"lz4", b"zstd")
MIN_CHAIN = 4
"""Consecutive valid records that confirm the place of a record [1]."""

_BEFORE_THE_END = frozenset(
    {
        Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK,
        Opcode.MESSAGE_INDEX, Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END,
    }
)  # fmt: skip
_AFTER_THE_END = frozenset(Opcode) - {Opcode.HEADER, Opcode.MESSAGE, Opcode.CHUNK}
_LENGTHS = {Opcode.DATA_END: 4, Opcode.FOOTER: 20}
_LEAST_OF_MESSAGE = 22


class ByteRange(NamedTuple):
    """A record from byte `begin` to before byte `end`."""

    opcode: int
    begin: int
    end: int

    @property
    def body(self) -> slice:
        """Where its content is."""
        return slice(self.begin + HEAD.size, self.end)


class Broken(NamedTuple):
    """Bytes that are no whole record; a chunk that was cut short may begin there."""

    begin: int
    end: int


def scan(data: mmap.mmap) -> Iterator[ByteRange | Broken]:
    """Go through a file from its first record to its footer, or to its end.

    The mark at its beginning has been checked.
    """
    at, size, ended = len(MCAP0_MAGIC), len(data), False
    while at < size:
        if ended and data[at:] == MCAP0_MAGIC:
            return
        piece = _piece_at(data, at, size, ended=ended)
        if piece is None:
            following = _next_piece(data, at + 1, size)
            yield Broken(at, following)
            at, ended = following, False
        else:
            yield piece
            at, ended = piece.end, ended or piece.opcode == Opcode.DATA_END
    yield Broken(size, size)


def _piece_at(data: mmap.mmap, at: int, size: int, *, ended: bool) -> ByteRange | None:
    if at + HEAD.size > size:
        return None
    opcode, length = HEAD.unpack_from(data, at)
    end = at + HEAD.size + length
    allowed = _AFTER_THE_END if ended else _BEFORE_THE_END
    if opcode not in allowed or end > size or length != _LENGTHS.get(opcode, length):
        return None
    if opcode == Opcode.MESSAGE_INDEX and not _is_index(data, at, length):
        return None
    if opcode == Opcode.MESSAGE and length < _LEAST_OF_MESSAGE:
        return None
    return ByteRange(opcode, at, end)


def _is_index(data: mmap.mmap, at: int, length: int) -> bool:
    if length < 6:
        return False
    (entries,) = struct.unpack_from("<I", data, at + HEAD.size + 2)
    return bool(entries == length - 6)


def _next_piece(data: mmap.mmap, at: int, size: int) -> int:
    """Return the start of the next plausible record; `size` if there is none."""
    for place in range(at, size - HEAD.size):
        opcode = data[place]
        if opcode == Opcode.CHUNK and _is_chunk(data, place, size):
            return place
        if opcode in _BEFORE_THE_END and _is_chain(data, place, size):
            return place
    return size


def _is_chunk(data: mmap.mmap, at: int, size: int) -> bool:
    """Whether the lengths of a chunk agree; it may be cut short."""
    name_at = at + HEAD.size + CHUNK_HEAD.size
    if name_at + 4 > size:
        return False
    _, length = HEAD.unpack_from(data, at)
    (name_length,) = struct.unpack_from("<I", data, name_at)
    records_at = name_at + 4 + name_length + 8
    if name_length > 4 or records_at > size:
        return False
    name = data[name_at + 4 : name_at + 4 + name_length]
    (records,) = struct.unpack_from("<Q", data, records_at - 8)
    stated = CHUNK_HEAD.size + 4 + name_length + 8 + records
    return name in COMPRESSIONS and bool(length == stated)


def _is_chain(data: mmap.mmap, at: int, size: int) -> bool:
    ended = False
    for _ in range(MIN_CHAIN):
        if ended and data[at:] == MCAP0_MAGIC:
            return True
        piece = _piece_at(data, at, size, ended=ended)
        if piece is None:
            return False
        at, ended = piece.end, ended or piece.opcode == Opcode.DATA_END
    return True

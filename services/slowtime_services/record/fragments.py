"""Records that are whole in a chunk that was cut short.

What was packed with zstd or LZ4 is unpacked as far as it goes: zstd by blocks of 128 KiB at
most, LZ4 up to the last byte.
"""

import struct
from collections.abc import Iterator
from io import BytesIO
from typing import NamedTuple

import lz4.block
import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Schema

from .chunks import LARGEST_CHUNK, LARGEST_WINDOW
from .scanning import CHUNK_HEAD, HEAD

STEP = 1 << 16
LEAST_ZEROS = 512
"""So many zero bytes at the end of a file were never written, but only made room for."""
_MESSAGE = struct.Struct("<HIQQ")
_LZ4_MAGIC = b"\x04\x22\x4d\x18"
_LZ4_WINDOW = 1 << 16


class Fragment(NamedTuple):
    """Part of a chunk: its compression, and as many of its bytes as were written."""

    compression: str
    stated: int
    packed: bytes


def fragment_of(data: bytes) -> Fragment | None:
    """Read the head of a chunk that is cut short; None where not even that is whole."""
    name_at = HEAD.size + CHUNK_HEAD.size
    if len(data) < name_at + 4 or data[0] != Opcode.CHUNK:
        return None
    _, _, stated, _ = CHUNK_HEAD.unpack_from(data, HEAD.size)
    (name_length,) = struct.unpack_from("<I", data, name_at)
    packed_at = name_at + 4 + name_length + 8
    if name_length > 4 or len(data) < packed_at:
        return None
    name = bytes(data[name_at + 4 : packed_at - 8])
    if name not in (b"", b"lz4", b"zstd"):
        return None
    (length,) = struct.unpack_from("<Q", data, packed_at - 8)
    packed = bytes(data[packed_at : packed_at + min(length, len(data))])
    return Fragment(name.decode(), stated, packed)


def without_zeros(data: bytes) -> bytes:
    """Remove unwritten bytes at the end, as a power cut leaves them."""
    stripped = data.rstrip(b"\0")
    return stripped if len(data) - len(stripped) >= LEAST_ZEROS else data


def whole_records(fragment: Fragment) -> Iterator[Schema | Channel | Message]:
    """Yield the records that are whole in a fragment, in their order."""
    most = min(fragment.stated or LARGEST_CHUNK, LARGEST_CHUNK)
    unpacked = _unpack(fragment, most)
    at = 0
    while at + HEAD.size <= len(unpacked):
        opcode, length = HEAD.unpack_from(unpacked, at)
        begins, at = at + HEAD.size, at + HEAD.size + length
        if at > len(unpacked) or opcode not in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
            return
        if opcode != Opcode.MESSAGE:
            stream = ReadDataStream(BytesIO(unpacked[begins:at]))
            yield Schema.read(stream) if opcode == Opcode.SCHEMA else Channel.read(stream)
        elif length >= _MESSAGE.size:
            channel, sequence, log_ns, publish_ns = _MESSAGE.unpack_from(unpacked, begins)
            content = unpacked[begins + _MESSAGE.size : at]
            yield Message(channel, log_ns, content, publish_ns, sequence)


def _unpack(fragment: Fragment, most: int) -> bytes:
    if fragment.compression == "zstd":
        return _unpack_zstd(fragment.packed, most)
    if fragment.compression == "lz4":
        return _unpack_lz4(fragment.packed, most)
    return fragment.packed[:most]


def _unpack_zstd(packed: bytes, most: int) -> bytes:
    unpacked = bytearray()
    unpacker = zstandard.ZstdDecompressor(max_window_size=LARGEST_WINDOW)
    with unpacker.stream_reader(packed) as reader:
        while len(unpacked) < most:
            try:
                piece = reader.read(min(STEP, most - len(unpacked)))
            except zstandard.ZstdError:
                break
            if not piece:
                break
            unpacked += piece
    return bytes(unpacked)


def _unpack_lz4(packed: bytes, most: int) -> bytes:
    """Unpack block after block; of the last one, which is cut short, as much as is there."""
    try:
        info = lz4.frame.get_frame_info(packed)
    except RuntimeError:
        return b""
    flags = packed[len(_LZ4_MAGIC)]
    at = len(_LZ4_MAGIC) + 3 + (8 if flags & 8 else 0) + (4 if flags & 1 else 0)
    unpacked = bytearray()
    while at + 4 <= len(packed) and len(unpacked) < most:
        (word,) = struct.unpack_from("<I", packed, at)
        length, plain = word & 0x7FFF_FFFF, word >> 31
        if length == 0:
            break
        block = packed[at + 4 : at + 4 + length]
        at += 4 + length + (4 if info["block_checksum"] else 0)
        if plain:
            unpacked += block
        else:
            _unpack_lz4_block(block, unpacked, len(unpacked) + int(info["block_size"]))
    return bytes(unpacked[:most])


def _unpack_lz4_block(block: bytes, unpacked: bytearray, most: int) -> None:
    """Append the unpacked bytes of an LZ4 block, up to where it breaks off."""
    try:
        unpacked += lz4.block.decompress(
            block,
            uncompressed_size=most - len(unpacked),
            dict=bytes(unpacked[-_LZ4_WINDOW:]),
        )
    except lz4.block.LZ4BlockError:
        _unpack_torn_block(block, unpacked, most)


def _unpack_torn_block(block: bytes, unpacked: bytearray, most: int) -> None:
    at, size = 0, len(block)

    def length(of: int) -> int:
        nonlocal at
        more = of == 15
        while more and at < size:
            of += block[at]
            more = block[at] == 255
            at += 1
        return of

    while at < size and len(unpacked) < most:
        token = block[at]
        at += 1
        literals = length(token >> 4)
        unpacked += block[at : at + literals]
        at += literals
        if at + 2 > size:
            return
        offset = block[at] | block[at + 1] << 8
        at += 2
        copied = min(4 + length(token & 15), most - len(unpacked))
        begin = len(unpacked) - offset
        if offset == 0 or begin < 0 or at >= size:
            return  # damaged; or how much is to be copied may not be all there
        whole, rest = divmod(copied, offset)
        pattern = bytes(unpacked[begin:])
        unpacked += pattern * whole + pattern[:rest]

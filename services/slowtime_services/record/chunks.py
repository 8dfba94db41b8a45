"""Decompression of the chunks of a recording, within a bound.

The library unpacks whatever a chunk holds; a few kilobytes can hold gigabytes. Here a chunk
unpacks to what it states, and it may state no more than its packed size explains.
"""

import dataclasses

import lz4.frame
import zstandard
from mcap.records import Chunk

LARGEST_CHUNK = 1 << 28
LARGEST_WINDOW = 1 << 27
FREE_BYTES = 1 << 24
"""What any chunk, and any recording, may unpack to [bytes]."""
MOST_TIMES = 50
"""Times its packed size that a larger one may unpack to [1]. Recorders begin a chunk after 1 to
4 MiB, and messages of numbers pack to a third or a tenth."""


class Unpacking:
    """Count of what the chunks of one file have unpacked to, which its size bounds.

    An index may name one chunk a thousand times.

    Parameters
    ----------
    file_bytes
        Size of the file [bytes].
    """

    def __init__(self, file_bytes: int) -> None:
        self._left = _most(file_bytes)

    def plain(self, chunk: Chunk) -> Chunk:
        """Unpack a chunk of the file, as `plain` does.

        Raises
        ------
        ValueError
            Where all of them are more than the size of the file explains.
        """
        self._left -= chunk.uncompressed_size
        if self._left < 0:
            raise ValueError(
                f"its chunks unpack to more than {MOST_TIMES} times the size of the file"
            )
        return plain(chunk)


def _most(packed: int) -> int:
    return max(FREE_BYTES, MOST_TIMES * packed)


def plain(chunk: Chunk) -> Chunk:
    """Unpack a chunk.

    Raises
    ------
    ValueError
        If it holds something else than it states, or too much.
    """
    stated = chunk.uncompressed_size
    if stated > LARGEST_CHUNK:
        raise ValueError(
            f"a chunk of {stated / 2**20:.0f} MiB; at most {LARGEST_CHUNK >> 20} MiB are "
            "unpacked at once"
        )
    if stated > _most(len(chunk.data)):
        raise ValueError(
            f"a chunk of {len(chunk.data):,} bytes that states {stated:,} unpacked, more than "
            f"{MOST_TIMES} times as much"
        )
    if chunk.compression == "zstd":
        unpacker = zstandard.ZstdDecompressor(max_window_size=LARGEST_WINDOW)
        with unpacker.stream_reader(chunk.data) as reader:
            data = reader.read(stated + 1)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=stated + 1)
    elif not chunk.compression:
        data = chunk.data
    else:
        raise ValueError(f"a chunk packed with {chunk.compression[:20]!r}, not zstd or lz4")
    if len(data) != stated:
        raise ValueError(f"a chunk that states {stated} bytes and holds another number")
    return dataclasses.replace(chunk, compression="", data=data)

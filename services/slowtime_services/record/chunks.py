"""Decompression of the chunks of a recording, within a bound.

The library unpacks whatever a chunk holds; a few kilobytes can hold gigabytes. Here a chunk
unpacks to what it states, and it may not state more than `LARGEST_CHUNK`.
"""

import dataclasses

import lz4.frame
import zstandard
from mcap.records import Chunk

LARGEST_CHUNK = 1 << 28
LARGEST_WINDOW = 1 << 27


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

"""Unpacked size of MATLAB files of version 5, which state none."""

import struct
import zlib
from pathlib import Path

from .expansion import refuse_expansion, unpacked_bound

_HEADING_BYTES, _ORDER_AT = 128, 126
_COMPRESSED = 15
"""Type of an element that is a deflated one [1]_.

.. [1] The MathWorks, "MAT-File Format", R2019b, table 1-1.
"""
_BLOCK_BYTES = 1 << 20


def refuse_mat_expansion(path: Path) -> None:
    """Refuse a file whose variables unpack to more than its size explains.

    Raises
    ------
    RecordError
        As soon as they do.
    """
    most, count = unpacked_bound(path.stat().st_size), 0
    with path.open("rb") as file:
        heading = file.read(_HEADING_BYTES)
        order = ">" if heading[_ORDER_AT:] == b"MI" else "<"
        while len(tag := file.read(8)) == 8:
            kind, size = struct.unpack(f"{order}II", tag)
            if kind != _COMPRESSED:
                file.seek(size, 1)
                continue
            unpacker, packed = zlib.decompressobj(), file.read(size)
            while packed and not unpacker.eof:
                count += len(unpacker.decompress(packed, _BLOCK_BYTES))
                packed = unpacker.unconsumed_tail
                if count > most:
                    refuse_expansion(path, count)

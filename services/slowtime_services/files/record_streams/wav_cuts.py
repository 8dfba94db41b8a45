"""Cuts of a WAV file into WAV files."""

import struct
from pathlib import Path
from typing import BinaryIO, NamedTuple

from slowtime_services.files.record import RecordError

from .pieces import FEWEST_ROWS, Pieces, edges

OF_ONE_SIZE = (1, 3, 0xFFFE)
"""Codes of formats whose frames are of one size: PCM, floating point, extensible."""
UNKNOWN = (0, 2**32 - 1)
"""Sizes of the data that a recorder writes which was never told to end."""


class _Frames(NamedTuple):
    """Where the frames of a WAV file are."""

    begin: int
    rows: int
    frame_bytes: int
    fmt: bytes
    order: str


def cut_wav(path: Path, piece_bytes: int, _skip: int | None) -> Pieces:
    """Frames of a WAV file, of any number of bits.

    Raises
    ------
    RecordError
        Where it is damaged, or its frames are compressed.
    """
    with path.open("rb") as file:
        found = _frames(path, file)
        rows = max(FEWEST_ROWS, piece_bytes // found.frame_bytes)
        for first, last in edges(found.rows, rows):
            file.seek(found.begin + first * found.frame_bytes)
            body = file.read((last - first) * found.frame_bytes)

            def write(place: Path, body: bytes = body) -> None:
                place.write_bytes(_wav(found, body))

            yield write, last / found.rows


def _frames(path: Path, file: BinaryIO) -> _Frames:
    """Walk through the chunks of a file up to its samples."""
    order = ">" if file.read(12)[:4] == b"RIFX" else "<"
    size, fmt = path.stat().st_size, b""
    while len(head := file.read(8)) == 8:
        name, length = head[:4], struct.unpack(f"{order}I", head[4:])[0]
        if name == b"fmt " and length <= 4096:
            fmt = file.read(length)
        elif name == b"data" and len(fmt) >= 16:
            form, _, _, _, frame_bytes = struct.unpack_from(f"{order}HHIIH", fmt)
            if form not in OF_ONE_SIZE or not frame_bytes:
                break
            there = size - file.tell()
            if length in UNKNOWN:
                length = there
            if length > there:
                raise RecordError(
                    f"{path.name} says that it holds {length:,} bytes of samples and has "
                    f"{there:,}: it was cut short. Copy it again, or mend its header."
                )
            return _Frames(file.tell(), length // frame_bytes, frame_bytes, fmt, order)
        else:
            file.seek(length, 1)
        file.seek(length % 2, 1)  # chunks begin at even places
    raise RecordError(
        f"{path.name} is not a valid WAV file of plain samples: PCM and floating "
        "point are read piece "
        "by piece. Convert it, or read it whole."
    )


def _wav(found: _Frames, body: bytes) -> bytes:
    """Make a file of some frames."""
    pad = b"\0" * (len(body) % 2)
    size = 4 + 8 + len(found.fmt) + len(found.fmt) % 2 + 8 + len(body) + len(pad)
    riff = b"RIFX" if found.order == ">" else b"RIFF"

    def chunk(name: bytes, content: bytes) -> bytes:
        length = struct.pack(f"{found.order}I", len(content))
        return name + length + content + b"\0" * (len(content) % 2)

    head = riff + struct.pack(f"{found.order}I", size) + b"WAVE"
    return head + chunk(b"fmt ", found.fmt) + chunk(b"data", body)

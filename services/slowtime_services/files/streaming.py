"""Long file in; its blocks, one after the other, in bounded memory out.

A file is cut into pieces that are files of its own kind, each with the heading of the whole,
and each piece is read by `read_record`. So a stream means what the whole file would; only what
can be told from the whole alone (a figure of the heading for all rows) is not held against it.
"""

import contextlib
import dataclasses
import itertools
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from slowtime.signals.block import Block

from .dialect import find_layout
from .read import read_record
from .record import Record, RecordError

PIECE_BYTES = 4 * 2**20
"""Size of a piece: large enough to tell columns and clock from, small beside any memory."""

BLOCK_ROWS = 8192
"""Rows of a block at most."""

RATE_TOLERANCE = 1e-3
"""Relative difference of rates up to which two pieces are of one stream."""

HEADING_BYTES = 2**20
"""Of a text, within which its first row of numbers is looked for."""

TEXT = (".csv", ".txt", ".tsv", ".dat", ".asc")
UTF_16 = (b"\xff\xfe", b"\xfe\xff")

Pieces = Iterator[tuple[Callable[[Path], None], float]]
"""What writes a piece to a place, and the share of the file up to its end."""


@dataclasses.dataclass(frozen=True, slots=True)
class RecordStream:
    """A record that is read as it goes.

    Parameters
    ----------
    head
        Record of the first piece: channels, units, rate, start, notes and assumptions.
    size
        Of the file [bytes].
    blocks
        Blocks with the share of the file that has been read by the end of each.
    """

    head: Record
    size: int
    blocks: Iterator[tuple[Block, float]]


def streams(path: Path) -> bool:
    """Whether a file is of a kind that is read piece by piece."""
    return path.suffix.lower() in (*_CUTS, *TEXT)


@contextlib.contextmanager
def open_record(
    path: str | Path, *, piece_bytes: int = PIECE_BYTES, **given: Any
) -> Iterator[RecordStream]:
    """Open a record whose blocks are read as they are asked for.

    NumPy ``.npy``, Parquet and text of any delimiter; the clock and the channels are those
    that the first piece shows.

    Parameters
    ----------
    piece_bytes
        Of the file that are read at once.
    given
        What a person says of the file, as `read_record` takes it.

    Raises
    ------
    RecordError
        (a ValueError) where the file is of a kind that is only read whole, or a piece is no
        record, or of another rate than the first; the text says what to do.
    """
    path = Path(path)
    if not streams(path):
        raise RecordError(
            f"{path.name} is of a kind that is only read whole. Read piece by piece are "
            f"{', '.join((*_CUTS, *TEXT))}; convert it, or read it whole."
        )
    with tempfile.TemporaryDirectory(prefix="slowtime-") as folder:
        place = Path(folder) / path.name
        records = _records(path, place, piece_bytes, given)
        head = next(records, None)
        if head is None:
            raise RecordError(f"{path.name} holds no rows.")
        yield RecordStream(head[0], path.stat().st_size, _blocks(path, head, records))


def _records(
    path: Path, place: Path, piece_bytes: int, given: dict[str, Any]
) -> Iterator[tuple[Record, float]]:
    """Read piece after piece; the channels of the first are asked of the others."""
    cut = _CUTS.get(path.suffix.lower(), _cut_text)
    asked = dict(given)
    for write, share in cut(path, piece_bytes, asked.get("skip_lines")):
        write(place)
        record = read_record(place, **asked)
        place.unlink()
        yield record, share
        asked["channels"] = given.get("channels") or record.channels
        asked["keep"] = ("all",)


def _blocks(
    path: Path, head: tuple[Record, float], rest: Iterator[tuple[Record, float]]
) -> Iterator[tuple[Block, float]]:
    """Count the rows of all pieces through, with what is missing between two of them."""
    first, rate = head[0], head[0].rate_hz
    index = 0
    for record, share in itertools.chain([head], rest):
        if abs(record.rate_hz / rate - 1) > RATE_TOLERANCE:
            raise RecordError(
                f"{path.name} is sampled at {rate:g} Hz at first and at {record.rate_hz:g} Hz "
                f"from row {index} on. Cut it there, or give --rate-hz."
            )
        if first.start_ns is not None and record.start_ns is not None:
            due = round((record.start_ns - first.start_ns) * 1e-9 * rate)
            index = due if due > index + 1 else index
        for block in record.blocks(BLOCK_ROWS / rate, start_ns=0):
            moved = dataclasses.replace(
                block,
                rate_hz=rate,
                first_index=index + block.first_index,
                start_ns=(first.start_ns or 0)
                + round((index + block.first_index) * 1e9 / rate),
            )
            yield moved, share
        index = moved.next_index


def _cut_npy(path: Path, piece_bytes: int, _skip: int | None) -> Pieces:
    """Rows of an array, whichever way it lies; it is mapped, not read."""
    try:
        whole = np.load(path, mmap_mode="r", allow_pickle=False)
    except ValueError as error:
        raise RecordError(f"{path.name} cannot be read as .npy: {error}") from error
    if whole.ndim == 2 and whole.shape[0] < whole.shape[1]:
        whole = whole.T
    rows = max(1024, piece_bytes // max(1, whole.nbytes // max(1, len(whole))))
    for first, last in _edges(len(whole), rows):

        def write(place: Path, first: int = first, last: int = last) -> None:
            np.save(place, np.ascontiguousarray(whole[first:last]))

        yield write, last / len(whole)


def _cut_parquet(path: Path, piece_bytes: int, _skip: int | None) -> Pieces:
    """Batches of rows of a Parquet file."""
    try:
        import pyarrow.parquet as pq
    except ImportError as error:
        raise RecordError(
            f"{path.name} is read by pyarrow, which is not installed. "
            'Run: pip install "slowtime[formats]"'
        ) from error
    with pq.ParquetFile(path) as file:
        total = max(1, file.metadata.num_rows)
        rows = max(1024, piece_bytes // (8 * max(1, file.metadata.num_columns)))
        done = 0
        for batch in file.iter_batches(batch_size=rows):

            def write(place: Path, batch: Any = batch) -> None:
                with pq.ParquetWriter(place, batch.schema) as writer:
                    writer.write_batch(batch)

            done += batch.num_rows
            yield write, done / total


def _cut_text(path: Path, piece_bytes: int, skip: int | None) -> Pieces:
    """Lines of a text, each piece behind the heading of the whole."""
    size = max(1, path.stat().st_size)
    with path.open("rb") as file:
        heading = _heading(path, file.read(HEADING_BYTES), skip)
        file.seek(len(heading))
        while lines := file.read(piece_bytes):
            lines += file.readline()
            rest = size - file.tell()
            if 0 < rest < piece_bytes // 4:
                lines += file.read()  # a last piece of a few rows tells no clock

            def write(place: Path, lines: bytes = lines) -> None:
                place.write_bytes(heading + lines)

            yield write, file.tell() / size


def _heading(path: Path, begins: bytes, skip: int | None) -> bytes:
    """Bytes before the first row of numbers."""
    if begins.startswith(UTF_16):
        raise RecordError(
            f"{path.name} is UTF-16, which is only read whole. Convert it to UTF-8, or read it "
            "whole."
        )
    lines = begins.splitlines(keepends=True)
    words = [line.decode("utf-8", "replace") for line in lines]
    return b"".join(lines[: find_layout(words, path.name, skip).first])


def _edges(count: int, rows: int) -> Iterator[tuple[int, int]]:
    """Begin and end of pieces of `rows`, the last one up to half as long again."""
    first = 0
    while first < count:
        last = count if count - first < 1.5 * rows else first + rows
        yield first, last
        first = last


_CUTS: dict[str, Callable[[Path, int, int | None], Pieces]] = {
    ".npy": _cut_npy,
    ".parquet": _cut_parquet,
}

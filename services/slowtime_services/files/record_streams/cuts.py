"""Cuts of a long file into pieces of its own kind."""

from pathlib import Path
from typing import Any

import numpy as np

from slowtime_services.files.delimited.dialect import find_layout
from slowtime_services.files.record import RecordError

from .hdf5_cuts import cut_hdf5
from .pieces import Cut, Pieces, edges
from .wav_cuts import cut_wav

HEADING_BYTES = 2**20
"""Of a text, within which its first row of numbers is looked for."""

TEXT = (".csv", ".txt", ".tsv", ".dat", ".asc")
UTF_16 = (b"\xff\xfe", b"\xfe\xff")


def _cut_npy(path: Path, piece_bytes: int, _skip: int | None) -> Pieces:
    """Rows of an array, whichever way it lies; it is mapped, not read."""
    try:
        whole = np.load(path, mmap_mode="r", allow_pickle=False)
    except ValueError as error:
        raise RecordError(f"{path.name} cannot be read as .npy: {error}") from error
    if whole.ndim == 2 and whole.shape[0] < whole.shape[1]:
        whole = whole.T
    rows = max(1024, piece_bytes // max(1, whole.nbytes // max(1, len(whole))))
    for first, last in edges(len(whole), rows):

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


def cut_text(path: Path, piece_bytes: int, skip: int | None) -> Pieces:
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


CUTS: dict[str, Cut] = {
    ".npy": _cut_npy,
    ".parquet": _cut_parquet,
    ".wav": cut_wav,
    **dict.fromkeys((".h5", ".hdf5", ".hdf", ".sdf5"), cut_hdf5),
}
"""Endings of files that are cut in a way of their own."""


def cut_of(path: Path) -> Cut | None:
    """Return the function that cuts files with this ending; None if there is none."""
    ending = path.suffix.lower()
    return CUTS.get(ending, cut_text if ending in TEXT else None)

"""Reader of long files, block by block in bounded memory.

A file is cut into pieces that are files of its own kind, each with the heading of the whole,
and each piece is read by `read_record`. So a stream means what the whole file would. The number
of points and the duration that a heading states are held against all rows at the end.
"""

import contextlib
import dataclasses
import itertools
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from slowtime.signals.block import Block
from slowtime_services.files.clocks.record_clock import BY_CLOCK
from slowtime_services.files.headings.sampling import Facts
from slowtime_services.files.plausibility import RowFigures, refuse_disagreement
from slowtime_services.files.record import Record, RecordError
from slowtime_services.files.record_reader import read_record
from slowtime_services.files.text_sheet import read_text

from .cuts import CUTS, TEXT, cut_of

PIECE_BYTES = 4 * 2**20
"""Size of a piece: large enough to tell columns and clock from, small beside any memory."""

APART_PIECE_BYTES = 2 * PIECE_BYTES
"""Size of one that a library reads in a process of its own, which takes a second to start."""

BLOCK_ROWS = 8192
"""Rows of a block at most."""

RATE_TOLERANCE = 1e-3
"""Relative difference of rates up to which two pieces are of one stream."""


@dataclasses.dataclass(frozen=True, slots=True)
class RecordStream:
    """A record that is read piece by piece.

    Parameters
    ----------
    head
        Record of the first piece: channels, units, rate, start, notes and assumptions.
    size
        Of the file [bytes].
    blocks
        Blocks with the share of the file that has been read by the end of each. Where a file
        without a clock ends at another number of points than its heading states, the last one
        is followed by a RecordError.
    end_notes
        What is only known once all blocks have been read.
    """

    head: Record
    size: int
    blocks: Iterator[tuple[Block, float]]
    end_notes: list[str] = dataclasses.field(default_factory=list)


def streams(path: Path) -> bool:
    """Whether a file is of a kind that is read piece by piece."""
    return cut_of(path) is not None


@contextlib.contextmanager
def open_record(
    path: str | Path, *, piece_bytes: int | None = None, **given: Any
) -> Iterator[RecordStream]:
    """Open a record whose blocks are read on request.

    NumPy ``.npy``, Parquet, WAV, HDF5 and text of any delimiter; the clock and the channels are
    those that the first piece shows.

    Parameters
    ----------
    piece_bytes
        Of the file that are read at once; None for what suits its kind.
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
            f"{', '.join((*CUTS, *TEXT))}; convert it, or read it whole."
        )
    if piece_bytes is None:
        read_here = path.suffix.lower() in (".npy", *TEXT)
        piece_bytes = PIECE_BYTES if read_here else APART_PIECE_BYTES
    with tempfile.TemporaryDirectory(prefix="slowtime-") as folder:
        place = Path(folder) / path.name
        stated = _Stated(path.name, given.get("rate_hz") is None)
        records = _records(path, place, piece_bytes, given, stated)
        head = next(records, None)
        if head is None:
            raise RecordError(f"{path.name} holds no rows.")
        notes: list[str] = []
        blocks = _blocks(path, head, records, stated, notes)
        yield RecordStream(head[0], path.stat().st_size, blocks, notes)


@dataclasses.dataclass(slots=True)
class _Stated:
    """Figures of a heading for all rows, and the rows counted so far.

    Parameters
    ----------
    counts
        Whether the figures count: a rate that a person gives overrules them.
    """

    file: str
    counts: bool
    facts: Facts = dataclasses.field(default_factory=Facts)
    named: bool = True
    columns: int = 1

    def learn(self, place: Path, given: dict[str, Any]) -> None:
        """Read the figures off the first piece of a text."""
        sheet = read_text(
            place, skip_lines=given.get("skip_lines"), date_order=given.get("date_order")
        )
        self.facts, self.columns = sheet.facts, len(sheet.columns)
        self.named = sheet.named or given.get("columns") is not None

    def hold(self, head: Record, samples: int, missing: int) -> str:
        """Compare the figures with all rows; return a sentence, or nothing if a clock is right.

        Raises
        ------
        RecordError
            Where they disagree, and no clock says who is right.
        """
        if not self.counts:
            return ""
        clocked = any(said.startswith(BY_CLOCK) for said in head.assumptions)
        width = head.samples.shape[1]
        wrapped = width == 1 and self.columns > 1 and not self.named and not clocked
        try:
            refuse_disagreement(
                self.file,
                self.facts,
                RowFigures(rows=samples, width=width, missing=missing, named=self.named),
                rate_hz=head.rate_hz,
                wrapped=wrapped,
            )
        except RecordError as error:
            if not clocked:
                raise
            return f"{error} The clock was believed."
        return ""


def _records(
    path: Path, place: Path, piece_bytes: int, given: dict[str, Any], stated: _Stated
) -> Iterator[tuple[Record, float]]:
    """Read piece after piece; the channels of the first are asked of the others."""
    cut = cut_of(path)
    assert cut is not None
    asked, is_text = dict(given), path.suffix.lower() in TEXT
    for number, (write, share) in enumerate(cut(path, piece_bytes, asked.get("skip_lines"))):
        write(place)
        if number == 0 and is_text and stated.counts:
            stated.learn(place, given)
        record = read_record(place, **asked, of_a_piece=True)
        place.unlink()
        yield record, share
        asked["channels"] = given.get("channels") or record.channels
        asked["keep"] = ("all",)


def _blocks(
    path: Path,
    head: tuple[Record, float],
    rest: Iterator[tuple[Record, float]],
    stated: _Stated,
    notes: list[str],
) -> Iterator[tuple[Block, float]]:
    """Yield the rows of all pieces, numbered, with the samples missing between two of them."""
    first, rate = head[0], head[0].rate_hz
    index = samples = 0
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
        index, samples = moved.next_index, samples + len(record.samples)
    said = stated.hold(first, samples, index - samples)
    notes.extend([said] * bool(said))

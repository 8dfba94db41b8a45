"""Reader of Nastran OUTPUT4 files: real matrices as text or binary, dense or sparse.

A file holds matrices one after the other, column by column. A column is a run of values from a
first row on, or, where it names row 0, strings of values with a head each. The head of a string
gives its length in words, plus one, and its first row: in two integers ("bigmat", marked by a
negative number of rows) or packed into one, length times 65536 plus row. A column after the
last one ends a matrix.

Sources: MSC Nastran DMAP Programmer's Guide, module OUTPUT4 (records and formats), and files
that Nastran and pyYeti wrote.
"""

import dataclasses
import itertools
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, TextIO

import numpy as np
from scipy import sparse

from .bounds import MOST_EMPTY_ROWS_ALONE, refuse_empty_rows
from .errors import MatrixFileError

OUTPUT4 = (".op4", ".ot4")

PACKED = 65536
"""Rows that the packed head of a string can tell apart [1]: length and row share 32 bits."""

_HEADS = {24: 4, 48: 8}
"""Length of the record that opens a matrix [bytes] → size of its integers [bytes]."""

_REAL, _SINGLE = (1, 2), (1, 3)
"""Types of numbers: 1 and 2 are real, 3 and 4 complex; 1 and 3 fill one word for each real."""

_SQUARE = (1, 2, 6)
"""Forms that are whole matrices: square, rectangular, symmetric."""

_FORMAT = re.compile(r"(\d+)[ED](\d+)\.\d+")
_BARE_EXPONENT = re.compile(r"(?<=[\d.])([+-]\d)")


@dataclasses.dataclass(frozen=True, slots=True)
class _Head:
    name: str
    columns: int
    rows: int
    form: int
    kind: int
    big: bool


_Run = tuple[int, int, np.ndarray]
"""Column and first row, counted from 1, and reals from there on."""


def read_output4(path: Path, name: str | None = None) -> sparse.csr_array:
    """Read one matrix of an OUTPUT4 file.

    Parameters
    ----------
    path
        Text or binary file, of either byte order, with integers of 4 or 8 bytes.
    name
        Of the matrix; needed where the file has several.

    Raises
    ------
    MatrixFileError
        Where there is no such matrix, it is complex or factored, or the file is damaged.
    """
    heads = list[_Head]()
    found: tuple[_Head, list[_Run]] | None = None
    try:
        for head, runs in _matrices(path):
            heads.append(head)
            wanted = head.name.upper() == (name or head.name).upper()
            kept = [run for run in runs if wanted]
            if wanted and found is None:
                found = head, kept
    except (StopIteration, RuntimeError, struct.error, ValueError) as error:
        raise MatrixFileError(
            f"{path.name} is cut short, or is not an OUTPUT4 file ({error or 'end of file'}). "
            "Write it again with OUTPUT4; if it is of another kind, rename it with the ending "
            "of that kind."
        ) from error
    if found is None or (name is None and len(heads) > 1):
        asked = "No variable was named" if name is None else f"The variable {name!r} was named"
        names = ", ".join(dict.fromkeys(head.name for head in heads))
        raise MatrixFileError(
            f"{asked}, and {path.name} holds {names or 'none'}. Name one, as in "
            f"`{{file: {path.name}, variable: {heads[0].name if heads else 'KAA'}}}`."
        )
    return _matrix(path, *found)


def _matrix(path: Path, head: _Head, runs: list[_Run]) -> sparse.csr_array:
    if head.kind not in _REAL or head.form not in _SQUARE:
        raise MatrixFileError(
            f"{head.name} of {path.name} has form {head.form} and type {head.kind}. Allowed "
            "are form 1, 2 or 6 (square, rectangular, symmetric) and type 1 or 2 (real); "
            "write the whole real matrix by OUTPUT4."
        )
    lengths = np.array([len(values) for _, _, values in runs], dtype=int)
    columns = np.repeat(np.array([column for column, _, _ in runs], dtype=int), lengths) - 1
    starts = np.array([row for _, row, _ in runs], dtype=int) - 1
    inside = np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    rows = np.repeat(starts, lengths) + inside
    values = np.concatenate([run for _, _, run in runs] or [np.zeros(0)])
    if len(rows) and (rows.min() < 0 or rows.max() >= head.rows or columns.min() < 0):
        raise MatrixFileError(
            f"{head.name} of {path.name} has {head.rows} rows and {head.columns} columns, and "
            "entries outside of them. The file is damaged; write it again."
        )
    busy = values != 0.0
    refuse_empty_rows(
        f"{head.name} of {path.name}",
        (head.rows, head.columns),
        int(busy.sum()),
        most=MOST_EMPTY_ROWS_ALONE,
    )
    return sparse.csr_array(
        (values[busy], (rows[busy], columns[busy])), shape=(head.rows, head.columns)
    )


def _matrices(path: Path) -> Iterator[tuple[_Head, Iterator[_Run]]]:
    """Every matrix of a file; the runs of one are to be used up before the next."""
    with path.open("rb") as file:
        first = file.read(4)
    orders = [o for o in "<>" if len(first) == 4 and struct.unpack(o + "i", first)[0] in _HEADS]
    if orders:
        with path.open("rb") as file:
            yield from _of_records(file, orders[0])
    else:
        with path.open(encoding="latin-1") as text:
            yield from _of_lines(text)


def _checked(columns: int, rows: int, form: int, kind: int, name: str) -> _Head:
    if columns < 0 or kind not in (1, 2, 3, 4) or rows == 0:
        raise ValueError(f"a matrix of {columns} columns, {rows} rows and type {kind}")
    return _Head(name.strip(), columns, abs(rows), form, kind, rows < 0)


# Binary files


def _record(file: BinaryIO, order: str) -> bytes | None:
    mark = file.read(4)
    if not mark:
        return None
    (size,) = struct.unpack(order + "i", mark)
    body = file.read(size)
    if size < 0 or len(body) != size or file.read(4) != mark:
        raise ValueError(f"a record of {size} bytes that is not whole")
    return body


def _of_records(file: BinaryIO, order: str) -> Iterator[tuple[_Head, Iterator[_Run]]]:
    while (body := _record(file, order)) is not None:
        word = _HEADS.get(len(body), 0)
        if not word:
            raise ValueError(f"a record of {len(body)} bytes where a matrix should begin")
        whole = order + ("4i" if word == 4 else "4q")
        numbers: tuple[int, int, int, int] = struct.unpack_from(whole, body)
        # A name has two words of four letters, whatever the size of a word.
        name = body[4 * word : 4 * word + 4] + body[5 * word : 5 * word + 4]
        head = _checked(*numbers, name.decode("latin-1").strip("\0"))
        yield head, _record_runs(file, order, head, word)


def _record_runs(file: BinaryIO, order: str, head: _Head, word: int) -> Iterator[_Run]:
    integer = np.dtype(f"{order}i{word}")
    size = word if head.kind in _SINGLE else 8
    real, each = np.dtype(f"{order}f{size}"), size // word
    while (body := _record(file, order)) is not None:
        column, row, words = np.frombuffer(body, integer, 3).tolist()
        if column > head.columns:
            return
        place = 3 * word
        if row > 0:
            yield column, row, np.frombuffer(body, real, words // each, place).astype(float)
            continue
        end = place + words * word
        while place < end:
            given = np.frombuffer(body, integer, 2 if head.big else 1, place).tolist()
            length, row = _string(given)
            place += len(given) * word
            yield column, row, np.frombuffer(body, real, length // each, place).astype(float)
            place += length * word
    raise ValueError(f"{head.name} without its end")


def _string(given: list[int]) -> tuple[int, int]:
    """Length in words and first row, of the head of a string."""
    if len(given) == 2:
        length, row = given[0] - 1, given[1]
    else:
        length, row = given[0] // PACKED - 1, given[0] % PACKED
    if length < 1:
        raise ValueError(f"a string of {length} words")
    return length, row


# Text files


def _of_lines(text: TextIO) -> Iterator[tuple[_Head, Iterator[_Run]]]:
    for line in text:
        if not line.strip():
            continue
        wide = 16 if line.rstrip().endswith("|I16") else 8
        widths = (wide, wide, 8, 8, 8)
        ends = list(itertools.accumulate(widths))
        parts = [line[e - w : e] for e, w in zip(ends, widths, strict=True)]
        columns, rows, form, kind = (int(part) for part in parts[:4])
        shape = _FORMAT.search(line[ends[-1] :])
        numbers = (int(shape[1]), int(shape[2])) if shape else (5, 16)
        head = _checked(columns, rows, form, kind, parts[4])
        yield head, _line_runs(text, head, numbers)


def _line_runs(text: TextIO, head: _Head, numbers: tuple[int, int]) -> Iterator[_Run]:
    each = 1 if head.kind in _SINGLE else 2
    for line in text:
        column, row, words = _integers(line, 3)
        if column > head.columns:
            _values(text, 1, numbers)
            return
        if row > 0:  # dense columns count numbers, strings count words
            yield column, row, _values(text, words, numbers)
            continue
        while words > 0:
            given = _integers(next(text), 2 if head.big else 1)
            length, row = _string(given)
            words -= length + len(given)
            yield column, row, _values(text, length // each, numbers)
    else:
        raise ValueError(f"{head.name} without its end")


def _integers(line: str, count: int) -> list[int]:
    parts = line.split()
    if len(parts) == count:
        return [int(part) for part in parts]
    return [int(line[k : k + 8]) for k in range(0, count * 8, 8)]


def _values(text: TextIO, count: int, numbers: tuple[int, int]) -> np.ndarray:
    """Numbers of fixed width, which may touch each other."""
    per_line, width = numbers
    lines = list(itertools.islice(text, -(-count // per_line)))
    whole = "".join(line.rstrip("\r\n")[: per_line * width] for line in lines)
    if count < 0 or (count - 1) * width >= max(len(whole), 1):
        raise ValueError(f"{count} numbers are stated and {len(whole)} characters follow")
    parts = [whole[k : k + width] for k in range(0, count * width, width)]
    try:
        return np.array(parts, dtype=float)
    except ValueError:
        plain = [part.upper().replace("D", "E") for part in parts]
        return np.array(
            [float(p if "E" in p else _BARE_EXPONENT.sub(r"E\1", p)) for p in plain]
        )

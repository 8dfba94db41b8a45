"""Writer of Nastran OUTPUT4 files; `nastran_output4` describes the format."""

import struct
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO, Literal, TextIO

import numpy as np
from scipy import sparse

from .errors import MatrixFileError
from .nastran_output4 import PACKED

Layout = Literal["bigmat", "nonbigmat", "dense"]

_DIGITS, _WIDTH, _PER_LINE = 16, 23, 3  # 17 significant digits bring back every double

_Run = tuple[int, np.ndarray]
"""First row, counted from 1, and values from there on."""


def write_output4(
    path: Path,
    matrices: Mapping[str, sparse.csr_array],
    *,
    layout: Layout = "bigmat",
    binary: bool = True,
) -> None:
    """Write real matrices to an OUTPUT4 file.

    Parameters
    ----------
    path
        File; an existing one is replaced.
    matrices
        Matrix by its name, eight characters at most.
    layout
        `bigmat` and `nonbigmat` are sparse, of any and of up to 65535 rows.
    binary
        Whether as records of 4-byte integers and doubles in the byte order of the machine, or
        as text with 17 significant digits.

    Raises
    ------
    MatrixFileError
        Where a name is too long, or the layout cannot hold so many rows.
    """
    for name, matrix in matrices.items():
        if not 0 < len(name) <= 8 or not name.isascii():
            raise MatrixFileError(
                f"A matrix of {path.name} is named {name!r}. OUTPUT4 allows one to eight ASCII "
                "characters."
            )
        if layout == "nonbigmat" and matrix.shape[0] >= PACKED:
            raise MatrixFileError(
                f"{name} has {matrix.shape[0]} rows. The layout nonbigmat holds up to "
                f"{PACKED - 1}; choose bigmat."
            )
    if binary:
        with path.open("wb") as file:
            for name, matrix in matrices.items():
                _write_binary(file, name, sparse.csc_array(matrix, dtype=float), layout)
        return
    with path.open("w", encoding="ascii", newline="\n") as text:
        for name, matrix in matrices.items():
            _write_text(text, name, sparse.csc_array(matrix, dtype=float), layout)


def _runs(matrix: sparse.csc_array, layout: Layout) -> Iterator[tuple[int, list[_Run]]]:
    """Find runs of neighbouring rows of each busy column; dense columns have one run."""
    matrix.sum_duplicates()
    matrix.eliminate_zeros()
    for column in range(matrix.shape[1]):
        part = slice(matrix.indptr[column], matrix.indptr[column + 1])
        rows, values = matrix.indices[part], matrix.data[part]
        if not len(rows):
            continue
        if layout == "dense":
            whole = np.zeros(rows[-1] - rows[0] + 1)
            whole[rows - rows[0]] = values
            yield column + 1, [(int(rows[0]) + 1, whole)]
            continue
        cuts = np.flatnonzero(np.diff(rows) > 1) + 1
        if layout == "nonbigmat":  # the packed length has 15 bits
            cuts = np.union1d(cuts, np.arange(PACKED // 8, len(rows), PACKED // 8)).astype(int)
        pieces = zip(np.split(rows, cuts), np.split(values, cuts), strict=True)
        yield column + 1, [(int(row[0]) + 1, value) for row, value in pieces]


def _open(matrix: sparse.csc_array, layout: Layout) -> tuple[int, int, int, int]:
    """Columns, rows, form and type, as the head of a matrix gives them."""
    rows, columns = matrix.shape
    form = 2 if rows != columns else 6 if not abs(matrix - matrix.T).max() else 1
    return columns, -rows if layout == "bigmat" else rows, form, 2


def _strings(
    runs: list[_Run], layout: Layout, head: Callable[[list[int]], bytes | str]
) -> tuple[int, list[tuple[bytes | str, np.ndarray]]]:
    """Words of a column, and head and values of each of its strings."""
    heads = []
    for row, values in runs:
        length = 2 * len(values) + 1
        packed = length * PACKED + row
        heads.append([length, row] if layout == "bigmat" else [packed])
    words = sum(2 * len(run[1]) + len(given) for run, given in zip(runs, heads, strict=True))
    return words, [(head(given), run[1]) for run, given in zip(runs, heads, strict=True)]


def _write_binary(file: BinaryIO, name: str, matrix: sparse.csc_array, layout: Layout) -> None:
    def record(body: bytes) -> None:
        mark = struct.pack("=i", len(body))
        file.write(mark + body + mark)

    record(struct.pack("=4i", *_open(matrix, layout)) + name.ljust(8).encode("ascii"))
    for column, runs in _runs(matrix, layout):
        if layout == "dense":
            ((row, values),) = runs
            record(struct.pack("=3i", column, row, 2 * len(values)) + values.tobytes())
            continue
        words, strings = _strings(runs, layout, lambda g: struct.pack(f"={len(g)}i", *g))
        body = b"".join(bytes(head) + values.tobytes() for head, values in strings)  # type: ignore[arg-type]
        record(struct.pack("=3i", column, 0, words) + body)
    record(struct.pack("=3id", matrix.shape[1] + 1, 1, 2, 1.0))


def _write_text(file: TextIO, name: str, matrix: sparse.csc_array, layout: Layout) -> None:
    def integers(given: list[int]) -> str:
        return "".join(f"{value:8d}" for value in given) + "\n"

    def numbers(values: np.ndarray) -> None:
        for k in range(0, len(values), _PER_LINE):
            part = values[k : k + _PER_LINE]
            file.write("".join(f"{value:{_WIDTH}.{_DIGITS}E}" for value in part) + "\n")

    opened = integers(list(_open(matrix, layout))).rstrip("\n")
    file.write(f"{opened}{name:<8}1P,{_PER_LINE}E{_WIDTH}.{_DIGITS}\n")
    for column, runs in _runs(matrix, layout):
        if layout == "dense":
            ((row, values),) = runs
            file.write(integers([column, row, len(values)]))
            numbers(values)
            continue
        words, strings = _strings(runs, layout, integers)
        file.write(integers([column, 0, words]))
        for head, values in strings:
            file.write(str(head))
            numbers(values)
    file.write(integers([matrix.shape[1] + 1, 1, 1]))
    numbers(np.ones(1))

"""Matrices as text: lines of row, column and value (CalculiX, Abaqus), or whole (OpenSees).

CalculiX writes `row column value` with ``*FREQUENCY, SOLVER=MATRIXSTORAGE`` (.sti, .mas).
Abaqus writes, with ``*MATRIX OUTPUT``, either the same (FORMAT=COORDINATE) or `node, direction,
node, direction, value` (FORMAT=MATRIX INPUT, behind a line ``*MATRIX, ...``). Either has one
triangle or both.
"""

import re
from pathlib import Path

import numpy as np
from scipy import sparse

from .bounds import refuse_empty_rows
from .errors import MatrixFileError

MARKET = "%%MatrixMarket"
_WHOLE = 2.0**53
"""Whole numbers below are exact as floating-point numbers [1]."""


def is_coordinate_text(path: Path) -> bool:
    """Whether a text file has bare lines rather than a heading of Matrix Market."""
    if path.suffix.lower() == ".gz":
        return False
    with path.open("rb") as file:
        return not file.read(len(MARKET)).decode("latin-1").startswith(MARKET)


def read_coordinate_text(path: Path) -> sparse.csr_array:
    """Read lines of row, column and value, or of two nodes and directions and a value.

    Rows of nodes and directions are in the order of the nodes, then of the directions.

    Parameters
    ----------
    path
        Text file.

    Returns
    -------
    The matrix as it is in the file.

    Raises
    ------
    MatrixFileError
        Where a line has neither three nor five numbers, or a row is not counted from 1.
    """
    table = _numbers(path)
    if table.shape[1] == 3:
        places, values = table[:, :2].astype(np.int64), table[:, 2]
        if places.min() < 1 or (places != table[:, :2]).any():
            raise MatrixFileError(
                f"{path.name} contains the row or column number {_refused(table[:, :2]):g}. "
                "They must be whole numbers, counted from 1; export the matrix numbered from 1."
            )
        size = int(places.max())
        return _summed(path.name, values, places - 1, size)
    pairs = node_directions(table)
    codes = np.unique(np.concatenate(pairs))
    places = np.column_stack([np.searchsorted(codes, pair) for pair in pairs])
    return _summed(path.name, table[:, 4], places, len(codes))


def _refused(places: np.ndarray) -> float:
    """Return the first number of a row or column that is none."""
    return float(places[(places < 1) | (places != np.round(places))].flat[0])


def read_dense_text(path: Path) -> np.ndarray:
    """Read a whole matrix, one line a row, as ``printA -file`` of OpenSees writes it.

    Parameters
    ----------
    path
        Text file.

    Raises
    ------
    MatrixFileError
        Where the lines are not of one length, or something is no number.
    """
    rows = [line.split() for line in path.read_text(encoding="latin-1").splitlines()]
    rows = [row for row in rows if row]
    lengths = sorted({len(row) for row in rows})
    if len(lengths) != 1 or len(rows) != lengths[0]:
        raise MatrixFileError(
            f"{path.name} has {len(rows)} lines of {', '.join(map(str, lengths)) or 'no'} "
            "numbers. Allowed is one square matrix, a line for each row; delete the file "
            "before `printA -file` writes it again, since that appends."
        )
    try:
        return np.array(rows, dtype=float)
    except ValueError as error:
        raise MatrixFileError(f"{path.name} is not a matrix of numbers: {error}.") from error


def node_directions(table: np.ndarray) -> list[np.ndarray]:
    """Codes, eight times node plus direction, of both sides of lines of five numbers."""
    return [
        8 * table[:, k].astype(np.int64) + table[:, k + 1].astype(np.int64) - 1 for k in (0, 2)
    ]


def _numbers(path: Path) -> np.ndarray:
    lines = path.read_text(encoding="latin-1").splitlines()
    kept = [line for line in lines if line.strip() and not re.match(r"\s*(\*|%|#|//)", line)]
    text = " ".join(kept).replace(",", " ").replace("D", "E").replace("d", "e")
    count = len(kept[0].replace(",", " ").split()) if kept else 0
    values = np.array(text.split(), dtype=float) if kept else np.zeros(0)
    if count not in (3, 5) or values.size != count * len(kept):
        raise MatrixFileError(
            f"{path.name} has {count} numbers in its first line and {values.size} in "
            f"{len(kept)} lines. Allowed are three (row, column, value) or five (node, "
            "direction, node, direction, value) in every line."
        )
    table = values.reshape(-1, count)
    if not (np.isfinite(table).all() and (np.abs(table[:, : count - 1]) < _WHOLE).all()):
        raise MatrixFileError(
            f"{path.name} has a number that is infinite, or a row, node or direction above "
            f"{_WHOLE:g}. Export it again."
        )
    return table


def _summed(name: str, values: np.ndarray, places: np.ndarray, size: int) -> sparse.csr_array:
    refuse_empty_rows(name, (size, size), len(values))
    return sparse.csr_array((values, (places[:, 0], places[:, 1])), shape=(size, size))

"""Bounds on what a file of matrices or of a mesh may make of a few bytes."""

import gzip
from collections.abc import Iterable, Iterator
from pathlib import Path

from slowtime_services.files.binary.expansion import refuse_expansion, unpacked_bound

from .errors import MatrixFileError

MOST_WRITTEN_OUT = 500_000
"""Numbers of points that a range or set is written out to [1]: `1 THRU 500000` is the longest
that a model of 3,000,000 degrees of freedom needs, and takes 50 MB."""

MOST_EMPTY_ROWS = 2_000_000
"""Rows without an entry of a sparse matrix [1]: each takes some ten bytes. Matrices of a group
of elements are empty elsewhere; whole models have a million rows."""

MOST_EMPTY_ROWS_ALONE = 12_000_000
"""Such rows of a matrix that is only read [1]: 48 MB. Whoever mirrors it allows fewer."""

_BLOCK_BYTES = 1 << 20


def written_out(numbers: range) -> Iterator[str]:
    """Write a range of numbers out.

    Raises
    ------
    MatrixFileError
        Where it is longer than any model needs.
    """
    count = (numbers.stop - numbers.start) // numbers.step  # `len` ends at 2^63
    if count > MOST_WRITTEN_OUT:
        raise MatrixFileError(
            f"A range from {numbers.start} has {count:.3g} numbers. Allowed: "
            f"{MOST_WRITTEN_OUT:,}. Check its end."
        )
    return map(str, numbers)


def refuse_long_set(members: Iterable[str], name: str) -> list[str]:
    """Return the members of a set; sets may contain sets, and themselves.

    Raises
    ------
    MatrixFileError
        Where there are more than any model has.
    """
    found = list[str]()
    for member in members:
        found.append(member)
        if len(found) > MOST_WRITTEN_OUT:
            raise MatrixFileError(
                f"The set {name} has more than {MOST_WRITTEN_OUT:,} members. Check whether it "
                "contains itself."
            )
    return found


def refuse_empty_rows(
    name: str, shape: tuple[int, ...], entries: int, *, most: int = MOST_EMPTY_ROWS
) -> None:
    """Refuse a shape that the entries of a matrix do not explain.

    Raises
    ------
    MatrixFileError
        Before anything of that shape is made.
    """
    if max(shape, default=0) > entries + most or min(shape, default=0) < 0:
        sides = " x ".join(f"{side:,}" for side in shape)
        raise MatrixFileError(
            f"{name} states a matrix of {sides} and has {entries:,} entries: it is damaged, or "
            "was made to fill memory. Number its rows without gaps, or export it again."
        )


def refuse_packed_text(path: Path) -> None:
    """Refuse a gzip file that unpacks to more than its size explains.

    Raises
    ------
    RecordError
        Saying so.
    """
    most, count = unpacked_bound(path.stat().st_size), 0
    with gzip.open(path) as file:
        while more := len(file.read(_BLOCK_BYTES)):
            count += more
            if count > most:
                refuse_expansion(path, count)

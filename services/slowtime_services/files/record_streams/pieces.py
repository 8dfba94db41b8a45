"""Pieces of a long file, and their edges."""

from collections.abc import Callable, Iterator
from pathlib import Path

Pieces = Iterator[tuple[Callable[[Path], None], float]]
"""What writes a piece to a place, and the share of the file up to its end."""

Cut = Callable[[Path, int, int | None], Pieces]
"""Cuts a file into pieces of so many bytes; lines before its heading or rows, if known."""

FEWEST_ROWS = 1024
"""Rows of a piece, from which columns and clock can be told."""


def edges(count: int, rows: int) -> Iterator[tuple[int, int]]:
    """Begin and end of pieces of `rows`, the last one up to half as long again.

    Examples
    --------
    >>> list(edges(24, 10))
    [(0, 10), (10, 24)]
    """
    first = 0
    while first < count:
        last = count if count - first < 1.5 * rows else first + rows
        yield first, last
        first = last

"""Ranges of sequences, so that work does not grow with how far a number reaches."""

import bisect
from collections.abc import Iterable, Sequence

MOST_RANGES = 256
"""Ranges that are remembered of one boot, the newest; some 5 KB where they are stored. They
only choose the words in which a late message is refused; events tell of every range."""

Range = tuple[int, int]
"""First and last sequence, both included."""


def covers(ranges: Sequence[Range], sequence: int) -> bool:
    """Whether one of some ascending ranges has a sequence.

    Examples
    --------
    >>> covers([(0, 3), (7, 7)], 2), covers([(0, 3), (7, 7)], 5)
    (True, False)
    """
    place = bisect.bisect_right(ranges, sequence, key=lambda one: one[0])
    return place > 0 and sequence <= ranges[place - 1][1]


def joined(ranges: Iterable[Range]) -> list[Range]:
    """Sort ranges, and join those that overlap or follow each other; empty ones are left out.

    Examples
    --------
    >>> joined([(7, 9), (1, 2), (3, 5), (8, 12), (4, 3)])
    [(1, 5), (7, 12)]
    """
    found: list[Range] = []
    for first, last in sorted(ranges):
        if first > last:
            continue
        if found and first <= found[-1][1] + 1:
            found[-1] = (found[-1][0], max(found[-1][1], last))
        else:
            found.append((first, last))
    return found


class Reasons:
    """Why the messages of some sequences were refused, as ranges of one reason each."""

    def __init__(self) -> None:
        self._ranges: list[tuple[int, int, str]] = []

    def __len__(self) -> int:
        return len(self._ranges)

    def add(self, sequence: int, reason: str) -> None:
        """Note one; beyond `MOST_RANGES` ranges the lowest, which are due first, stay."""
        place = self._place(sequence)
        if place and sequence <= self._ranges[place - 1][1]:
            return
        first = last = sequence
        if place < len(self._ranges) and self._ranges[place][::2] == (sequence + 1, reason):
            last = self._ranges.pop(place)[1]
        if place and self._ranges[place - 1][1:] == (sequence - 1, reason):
            place -= 1
            first = self._ranges.pop(place)[0]
        self._ranges.insert(place, (first, last, reason))
        del self._ranges[MOST_RANGES:]

    def forget(self, before: int) -> None:
        """Drop what lies before a sequence."""
        while self._ranges and self._ranges[0][1] < before:
            del self._ranges[0]

    def first_part(self, hole: Range) -> tuple[Range, str | None]:
        """Return the first part of a hole that has one reason, or none, and that reason."""
        first, last = hole
        place = self._place(first)
        if place and first <= self._ranges[place - 1][1]:
            _, end, reason = self._ranges[place - 1]
            return (first, min(last, end)), reason
        if place < len(self._ranges):
            last = min(last, self._ranges[place][0] - 1)
        return (first, last), None

    def _place(self, sequence: int) -> int:
        """Return how many ranges begin at a sequence or before it."""
        return bisect.bisect_right(self._ranges, sequence, key=lambda one: one[0])

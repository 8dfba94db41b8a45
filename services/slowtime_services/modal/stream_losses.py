"""Samples that are missing in a stream: drawn piece by piece, and what to say of them."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np

from slowtime_services.files import Gap, Record

from .losses import completed, inflation_of

PIECE_ROWS = 1 << 15
"""Rows of which missing samples are drawn at once [1]: eight times the lags of the covariance
that they are drawn by, and 4 MB of 16 channels."""

LONGEST_ROWS = PIECE_ROWS // 8
"""Missing rows in a row that are drawn, at most [1]: the covariance reaches no further."""

Rows = np.ndarray[Any, Any]


@dataclasses.dataclass(slots=True, eq=False)
class StreamLosses:
    """Draws the missing samples of a stream, and counts them.

    Parameters
    ----------
    head
        Record with rate, channels and units of the stream.
    missing, total
        Rows drawn so far, and rows in all.
    """

    head: Record
    missing: int = 0
    total: int = 0
    free: float = 0.0
    flags: tuple[str, ...] = ()

    @property
    def inflation(self) -> float:
        """Factor of standard deviations, as of a record that is read whole [1]."""
        if not self.missing:
            return 1.0
        return inflation_of(self.missing / self.total, self.free / self.missing)

    @property
    def note(self) -> str:
        """What was done; empty where nothing was missing."""
        if not self.missing:
            return ""
        said = (
            f"{self.missing} missing samples ({100 * self.missing / self.total:.1f} %) were "
            "drawn from what the others say of them; standard deviations are larger by the "
            "loss."
        )
        return said + (
            " Samples are missing where the level is high, as after an overflow, which biases "
            "damping." * bool(self.flags)
        )

    def drawn(self, blocks: Iterator[tuple[int, Rows]]) -> Iterator[tuple[int, Rows]]:
        """Give blocks on as longer ones, without the gaps that are short.

        Parameters
        ----------
        blocks
            Index of the first row, and rows, of blocks that follow each other.

        Yields
        ------
        Index of the first row, and rows, missing ones drawn.
        """
        held: list[tuple[int, Rows]] = []
        for first, rows in blocks:
            if not len(rows):
                continue
            if held and first - _end(held) > LONGEST_ROWS:
                yield self._whole(held)
                held = []
            if len(held) == 1 and first == _end(held):
                yield self._whole(held)  # nothing is missing so far: given on at once
                held = []
            held.append((first, rows))
            if _end(held) - held[0][0] >= PIECE_ROWS:
                # Cut within a block: the rows on either side of the cut are there.
                cut = max(len(rows) // 2, 1)
                held[-1] = first, rows[:cut]
                yield self._whole(held)
                held = [(first + cut, rows[cut:])] if cut < len(rows) else []
        if held:
            yield self._whole(held)

    def _whole(self, held: list[tuple[int, Rows]]) -> tuple[int, Rows]:
        begin, total = held[0][0], _end(held) - held[0][0]
        samples = np.concatenate([rows for _, rows in held])
        self.total += total
        if len(samples) == total:
            return begin, samples
        record = dataclasses.replace(self.head, samples=samples, gaps=_gaps(held), aux={})
        made = completed(record, "use")
        if made.present is None:
            # Given on as it is: rows that are lost are NaN for those who read streams.
            there = np.full((total, samples.shape[1]), np.nan)
            for first, rows in held:
                there[first - begin : first - begin + len(rows)] = rows
            return begin, there
        self.missing += total - len(samples)
        self.free += made.spread * (total - len(samples))
        self.flags = made.flags or self.flags
        return begin, np.asarray(made.record.samples)


def _end(held: list[tuple[int, Rows]]) -> int:
    first, rows = held[-1]
    return first + len(rows)


def _gaps(held: list[tuple[int, Rows]]) -> tuple[Gap, ...]:
    gaps, row, due = [], 0, held[0][0]
    for first, rows in held:
        if first > due:
            gaps.append(Gap(row, first - due))
        row, due = row + len(rows), first + len(rows)
    return tuple(gaps)

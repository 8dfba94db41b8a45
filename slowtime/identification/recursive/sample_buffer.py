"""Buffer of the last samples of a stream."""

import dataclasses

import numpy as np
from jaxtyping import Float

PIECE = 512
"""Rows up to which a block is joined to the one before."""

Rows = Float[np.ndarray, "time channel"]
Piece = Float[np.ndarray, "_ channel"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SampleBuffer:
    """Samples from `first_index` on, in pieces: a long tail is not copied for each block."""

    first_index: int = 0
    pieces: tuple[Piece, ...] = ()

    @property
    def next_index(self) -> int:
        """Index of the sample after the last one."""
        return self.first_index + sum(len(piece) for piece in self.pieces)

    def extended(self, rows: Rows) -> "SampleBuffer":
        """Buffer with more rows, which are copied."""
        if self.pieces and rows.shape[1] != self.pieces[-1].shape[1]:
            raise ValueError(
                f"A block of {rows.shape[1]} channels was given after blocks of "
                f"{self.pieces[-1].shape[1]}. Start anew where the channels change."
            )
        before, last = self.pieces, np.array(rows, dtype=float)
        if before and len(before[-1]) + len(last) <= PIECE:
            before, last = before[:-1], np.concatenate([before[-1], last])
        return SampleBuffer(self.first_index, (*before, last))

    def rows(self, first: int, count: int) -> Rows:
        """Rows from an index on."""
        parts, at = [], self.next_index
        for piece in reversed(self.pieces):
            at -= len(piece)
            if at < first + count:
                parts.append(piece[max(0, first - at) : first + count - at])
            if at <= first:
                break
        return np.concatenate(parts[::-1])

    def from_index(self, index: int) -> "SampleBuffer":
        """Buffer without the rows before an index, where copying pays."""
        first, kept = self.first_index, list(self.pieces)
        while kept and first + len(kept[0]) <= index:
            first += len(kept.pop(0))
        if kept and index - first > len(kept[0]) // 2:
            kept[0] = kept[0][index - first :].copy()
            first = index
        return SampleBuffer(first, tuple(kept))

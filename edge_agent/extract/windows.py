"""Gathers blocks to windows: an epoch, or a stretch of `window_s` of a continuous stream."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int, Real

from slowtime.signals.block import Block

Rows = Float[np.ndarray, "time channel"]
Marks = Int[np.ndarray, "time 2"]
Part = tuple[Real[np.ndarray, "_ channel"], Int[np.ndarray, "_ 2"]]


@dataclasses.dataclass(frozen=True, slots=True)
class Stretch:
    """Rows that follow each other without a break."""

    first_index: int
    start_ns: int
    parts: tuple[Part, ...]
    count: int

    @property
    def next_index(self) -> int:
        """Index of the sample after the last one."""
        return self.first_index + self.count

    def joined(self) -> tuple[Rows, Marks]:
        """All rows and marks in one piece; parts are only joined once a window is whole."""
        if len(self.parts) == 1:
            only, its_marks = self.parts[0]
            return np.asarray(only, dtype=float), its_marks
        rows, marks = zip(*self.parts, strict=True)
        return np.concatenate(rows, dtype=float), np.concatenate(marks)


@dataclasses.dataclass(frozen=True, slots=True)
class GatheredWindow:
    """The part of a window that has arrived."""

    latest: Block
    stretches: tuple[Stretch, ...]
    windows: int = 0
    """How many windows the stretch has given already."""
    skip: int = 0
    """Rows of the stretch before the next window."""


def belongs(block: Block, gathered: GatheredWindow) -> bool:
    """Whether a block continues the open window."""
    latest = gathered.latest
    same = (
        block.epoch == latest.epoch
        and block.rate_hz == latest.rate_hz
        and block.channels == latest.channels
    )
    return same and (
        block.epoch is not None or block.first_index == gathered.stretches[-1].next_index
    )


def gather(
    gathered: GatheredWindow | None, block: Block, marks: Marks, max_samples: int
) -> GatheredWindow:
    """Add a block to the open window; samples beyond an epoch are left out."""
    # In the sensor's own type, which may be half as wide, until a window is whole.
    rows = np.asarray(block.samples)
    fresh = Stretch(block.first_index, block.start_ns, ((rows, marks),), len(rows))
    if gathered is None:
        return GatheredWindow(block, (fresh,))
    *before, last = gathered.stretches
    held = sum(stretch.count for stretch in gathered.stretches)
    if block.epoch is not None and held + fresh.count > max_samples:
        return gathered
    if fresh.first_index != last.next_index:
        return dataclasses.replace(gathered, latest=block, stretches=(*before, last, fresh))
    joined = dataclasses.replace(
        last, parts=last.parts + fresh.parts, count=last.count + fresh.count
    )
    return dataclasses.replace(gathered, latest=block, stretches=(*before, joined))


def part_of_stretch(stretch: Stretch, first: int, last: int, latest: Block) -> Stretch:
    """Rows `first` to `last` of a stretch, as a stretch that begins there."""
    rows, marks = stretch.joined()
    part = rows[first:last], marks[first:last]
    if 2 * (last - first) < len(rows):
        part = part[0].copy(), part[1].copy()  # a view would keep all of the rows
    start_ns = stretch.start_ns + round(first * 1e9 / latest.rate_hz)
    # Where a clock model stamps the blocks, the latest one knows best when any row was taken.
    if latest.clock is not None:
        behind = latest.first_index - (stretch.first_index + first)
        start_ns = latest.start_ns - round(behind * 1e9 / latest.true_rate_hz)
    return Stretch(stretch.first_index + first, start_ns, (part,), last - first)

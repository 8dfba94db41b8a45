"""Assembles indexed samples to runs without gaps, and counts those that are late or lost."""

import collections
from typing import NamedTuple

import numpy as np

from edge_agent.acquire.live.batch import Rows
from edge_agent.acquire.live.counts import SampleCounts

MOST_WAITING = 16_000_000
"""Numbers of all channels together that are waited for at most, whatever rate and settings
say [1]: 128 MiB."""


class SampleRun(NamedTuple):
    """Rows that follow each other, and the index of the first."""

    first_index: int
    rows: np.ndarray


class Assembler:
    """Puts rows in their places, waits for those that are late, and counts those that are not.

    Parameters
    ----------
    lanes
        Columns of each lane: one lane for all, or one for the channels of each topic.
    horizon
        How many rows a missing one is waited for.
    """

    def __init__(
        self,
        lanes: tuple[tuple[int, ...], ...],
        block_rows: int,
        horizon: int,
        tally: SampleCounts,
    ) -> None:
        self._lanes = [list(lane) for lane in lanes]
        self._columns = sum(len(lane) for lane in lanes)
        self._most_rows = max(1, MOST_WAITING // self._columns)
        self._block_rows = min(block_rows, self._most_rows)
        self._horizon, self._tally = min(horizon, self._most_rows), tally
        self._base = self._front = 0
        self._whole, self._longest = True, 0
        begun = max(64, min(2 * (self._block_rows + self._horizon), self._most_rows))
        self._rows = np.full((begun, self._columns), np.nan)
        self._seen = np.zeros((len(self._rows), len(lanes)), dtype=bool)
        self._lost: collections.deque[tuple[int, int]] = collections.deque(maxlen=256)
        self._out: list[SampleRun] = []

    def put(self, index: int, rows: Rows, lane: int = 0) -> None:
        """Put rows of one lane at their indices."""
        count = len(rows)
        self._tally.add("samples_received", count)
        if self._horizon and count > self._longest:
            # Two messages that change places are as far apart as they are long.
            self._longest = count
            self._horizon = min(max(self._horizon, 2 * count), self._most_rows)
        if index < self._base:
            late = min(count, self._base - index)
            self._judge_late(index, late)
            index, rows, count = index + late, rows[late:], count - late
            if not count:
                return
        if index + count - self._base > len(self._rows):
            self._make_room(index, count)
        begin, end = index - self._base, index - self._base + count
        seen = self._seen[begin:end, lane]
        if (index < self._front and len(self._lanes) == 1) or seen.any():
            twice = int(seen.sum())
            self._tally.add("samples_duplicated", twice)
            if len(self._lanes) == 1:
                early = min(count, max(0, self._front - index))
                self._tally.add("samples_reordered", early - twice)
        if len(self._lanes) == 1:
            self._rows[begin:end] = rows
        else:
            self._rows[begin:end, self._lanes[lane]] = rows
        self._seen[begin:end, lane] = True
        if index != self._front or len(self._lanes) > 1:
            self._whole = False
        self._front = max(self._front, index + count)

    def restart(self, index: int) -> None:
        """Release all rows; continue at `index`, without loss in between."""
        self._release(self._front)
        self._base = self._front = max(index, self._front)
        self._whole = True

    @property
    def waiting_rows(self) -> int:
        """Rows that have been put and not taken."""
        return self._front - self._base + sum(len(run.rows) for run in self._out)

    def take(self, *, all_of_it: bool = False) -> list[SampleRun]:
        """Return runs that no later message can change; all after a time without messages."""
        if all_of_it:
            self._release(self._front)
        elif self._front - self._base >= self._block_rows:
            if not self._whole:
                self._whole = bool(self._seen[: self._front - self._base].all())
            if self._whole:
                self._release(self._front)
            elif self._front - self._base >= self._block_rows + self._horizon:
                self._release(self._front - self._horizon)
        out, self._out = self._out, []
        return out

    def _judge_late(self, index: int, count: int) -> None:
        """Count rows that come after their place was given up."""
        lost = sum(
            max(0, min(index + count, end) - max(index, begin)) for begin, end in self._lost
        )
        self._tally.add("samples_late", lost)
        self._tally.add("samples_duplicated", count - lost)

    def _make_room(self, index: int, count: int) -> None:
        """Give up waiting, or grow, until `count` rows fit at `index`."""
        if index > self._front + self._horizon:
            self._release(self._front)
            self._lose(index - self._base)
            self._base = self._front = index
        else:
            self._release(min(self._front, max(self._base, index - self._horizon)))
        needed = index + count - self._base
        if needed > len(self._rows):
            more = 2 * needed - len(self._rows)
            self._rows = np.vstack([self._rows, np.full((more, self._columns), np.nan)])
            self._seen = np.vstack([self._seen, np.zeros((more, len(self._lanes)), bool)])

    def _release(self, limit: int) -> None:
        """Release the rows before `limit`, split where rows are missing."""
        count = limit - self._base
        if count <= 0:
            return
        present = np.asarray(self._seen[:count].any(axis=1))
        if present.all():
            self._out.append(SampleRun(self._base, self._rows[:count].copy()))
        else:
            self._release_parts(present)
        kept = self._front - limit
        self._rows[:kept] = self._rows[count : count + kept]
        self._seen[:kept] = self._seen[count : count + kept]
        self._rows[kept : count + kept] = np.nan
        self._seen[kept : count + kept] = False
        self._base = limit

    def _release_parts(self, present: np.ndarray) -> None:
        edges = np.flatnonzero(np.diff(np.r_[False, present, False].astype(np.int8)))
        place = 0
        for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            self._note_lost(self._base + place, begin - place)
            self._out.append(SampleRun(self._base + begin, self._rows[begin:end].copy()))
            place = end
        self._note_lost(self._base + place, len(present) - place)

    def _lose(self, count: int) -> None:
        self._note_lost(self._base, count)

    def _note_lost(self, first: int, count: int) -> None:
        if count > 0:
            self._tally.add("samples_lost", count)
            self._lost.append((first, first + count))

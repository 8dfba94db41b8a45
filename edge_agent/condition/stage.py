"""Second stage of the edge: bridges short gaps in blocks and limits their band.

Missing samples and single-sample spikes are bridged from their neighbours and marked. Nothing
here smooths: a filter such as median or EWMA on raw vibration changes gain and phase within the
band in which modes are sought. Offsets are left alone as well: a running mean would leave a
transient, while identification takes mean and trend of the whole window off.

The stream is worked in chunks counted from the start of each segment, each seen with the same
margin of neighbours, so that cutting the stream elsewhere changes nothing.
"""

import dataclasses
import functools
from collections.abc import Iterator
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from edge_agent.settings import ConditionSettings
from slowtime.signals.block import Block
from slowtime.signals.recursive_filters import at_rest, butterworth, chebyshev, filtered

from .spikes import REACH, bridged, usual_deviation, without_spikes

CHUNK = 256
"""Samples over which the usual deviation of a spike test is taken."""

MOST_BRIDGED = 16_384
"""Longest run of missing samples that is bridged, whatever `max_gap_s` and the rate say [1].
Each chunk is seen with as many neighbours on either side: 128 times its own samples."""

MOST_AT_ONCE = 4_000_000
"""Numbers of chunks with their margins that are worked at once [1]: 32 MB."""

Marked = tuple[Block, Int[np.ndarray, "_ 2"]]
"""A block, and for each of its rows how many samples were missing and how many were spikes."""


@dataclasses.dataclass(frozen=True, slots=True)
class PendingSegment:
    """Samples without a break, as far as they are not worked yet."""

    latest: Block
    first_index: int
    """Of the segment."""
    next_index: int
    """Of the first row not worked yet."""
    rows: Float[np.ndarray, "time channel"]
    """Rows not worked yet, after up to a margin of rows that are; NaN where missing."""
    margin: int
    """How many of `rows` are worked already."""
    scale: Float[np.ndarray, " channel"] | None
    """Usual deviation from the neighbours' mean in the chunk before."""
    memory: Float[np.ndarray, "section 2 channel"] | None
    """Of the filter."""


@dataclasses.dataclass(frozen=True, slots=True)
class Conditioner:
    """Mend, filter and decimate."""

    settings: ConditionSettings

    def start(self) -> PendingSegment | None:
        """Nothing seen yet."""
        return None

    def step(
        self, state: PendingSegment | None, block: Block
    ) -> tuple[PendingSegment | None, tuple[Marked, ...]]:
        """Take one block of any length; return the blocks that are complete."""
        out: list[Marked] = []
        for piece in _pieces(block):
            if state is not None and not self._continues(state, piece):
                state, rest = self.finish(state)
                out += rest
            state = _begin(piece) if state is None else _extend(state, piece)
            margin = self._margin(piece.rate_hz)
            ready = (len(state.rows) - state.margin - margin) // CHUNK * CHUNK
            numbers = (CHUNK + 2 * margin) * len(piece.channels)
            at_once = CHUNK * max(1, MOST_AT_ONCE // numbers)
            while ready > 0:
                state, done = self._work(state, min(ready, at_once))
                out += done
                ready -= at_once
        return state, tuple(out)

    def finish(self, state: PendingSegment | None) -> tuple[None, tuple[Marked, ...]]:
        """Return the rest of the segment, which no block continues."""
        if state is None:
            return None, ()
        out: list[Marked] = []
        while (left := len(state.rows) - state.margin) > 0:
            state, done = self._work(state, CHUNK if left >= CHUNK else left)
            out += done
        return None, tuple(out)

    def _longest_gap(self, rate_hz: float) -> int:
        return round(min(self.settings.max_gap_s * rate_hz, MOST_BRIDGED))

    def _margin(self, rate_hz: float) -> int:
        return REACH + max(1, self._longest_gap(rate_hz))

    def _continues(self, state: PendingSegment, block: Block) -> bool:
        end = state.next_index + len(state.rows) - state.margin
        gap = block.first_index - end
        same = (
            block.epoch == state.latest.epoch
            and block.rate_hz == state.latest.rate_hz
            and block.channels == state.latest.channels
        )
        return same and 0 <= gap <= self._longest_gap(block.rate_hz)

    def _work(self, state: PendingSegment, count: int) -> tuple[PendingSegment, list[Marked]]:
        """Work the next `count` rows: whole chunks, or the last part of one."""
        margin = self._margin(state.latest.rate_hz)
        windows, outside = _windows(state, count, margin)
        inner = slice(margin, windows.shape[1] - margin)
        missing = np.isnan(windows)
        filled = bridged(windows, missing)
        scale = state.scale
        spikes = np.zeros_like(missing)
        if self.settings.spikes:
            scales = usual_deviation(filled[:, inner], state.scale)
            filled, spikes = without_spikes(
                filled, missing, outside, scales, self.settings.spike_threshold
            )
            scale = scales[-1]
        clean = filled[:, inner].reshape(count, -1)
        marks = np.stack(
            [
                missing[:, inner].reshape(count, -1).any(axis=1),
                spikes[:, inner].reshape(count, -1).sum(axis=1),
            ],
            axis=1,
        ).astype(np.int64)
        clean, memory = self._filter(state, clean)
        marked = self._decimate(state, clean, marks)
        keep = max(0, state.margin + count - margin)
        after = dataclasses.replace(
            state,
            next_index=state.next_index + count,
            rows=state.rows[keep:],
            margin=state.margin + count - keep,
            scale=scale,
            memory=memory,
        )
        return after, marked

    def _filter(
        self, state: PendingSegment, rows: Float[np.ndarray, "time channel"]
    ) -> tuple[
        Float[np.ndarray, "time channel"], Float[np.ndarray, "section 2 channel"] | None
    ]:
        sections = _sections(self.settings, state.latest.rate_hz)
        if sections is None:
            return rows, None
        memory = state.memory
        if memory is None:
            # At rest at the first sample, so that an offset does not ring.
            memory = at_rest(sections)[:, :, None] * rows[0]
        return filtered(sections, rows, memory)

    def _decimate(
        self,
        state: PendingSegment,
        rows: Float[np.ndarray, "worked channel"],
        marks: Int[np.ndarray, "worked 2"],
    ) -> list[Marked]:
        """Keep each `decimate`-th sample, counted from the start of the stream."""
        factor, latest, first = self.settings.decimate, state.latest, state.next_index
        kept = np.arange(-first % factor, len(rows), factor)
        if len(kept) == 0:
            return []
        sums = marks
        if factor > 1:
            sums = np.add.reduceat(marks, np.r_[0, kept[1:]], axis=0)
        index = first + int(kept[0])
        behind = latest.first_index - index
        block = dataclasses.replace(
            latest,
            samples=rows[kept],
            rate_hz=latest.rate_hz / factor,
            first_index=index // factor,
            start_ns=latest.start_ns - round(behind * 1e9 / latest.true_rate_hz),
        )
        return [(block, sums)]


def _pieces(block: Block) -> Iterator[Block]:
    """Stretches of rows that hold anything; rows of nothing but NaN count as not sent."""
    samples = block.samples.astype(float)
    samples[~np.isfinite(samples)] = np.nan
    present = ~np.isnan(samples).all(axis=1)
    edges = np.flatnonzero(np.diff(present.astype(np.int8), prepend=0, append=0))
    for first, last in edges.reshape(-1, 2).tolist():
        yield dataclasses.replace(
            block,
            samples=samples[first:last],
            first_index=block.first_index + first,
            start_ns=block.start_ns + round(first * 1e9 / block.true_rate_hz),
        )


def _begin(block: Block) -> PendingSegment:
    rows = np.asarray(block.samples, dtype=float)
    return PendingSegment(block, block.first_index, block.first_index, rows, 0, None, None)


def _extend(state: PendingSegment, block: Block) -> PendingSegment:
    gap = block.first_index - (state.next_index + len(state.rows) - state.margin)
    nothing = np.full((gap, state.rows.shape[1]), np.nan)
    rows = np.concatenate([state.rows, nothing, block.samples])
    return dataclasses.replace(state, latest=block, rows=rows)


def _windows(
    state: PendingSegment, count: int, margin: int
) -> tuple[Float[np.ndarray, "chunk time channel"], Bool[np.ndarray, "chunk time"]]:
    """Each chunk with its margins; NaN, and marked, where those lie outside of the segment."""
    chunk = CHUNK if count >= CHUNK else count
    before = margin - state.margin
    available = len(state.rows) - state.margin - count
    after = max(0, margin - available)
    rows = state.rows[: state.margin + count + min(margin, available)]
    padded = np.concatenate(
        [
            np.full((before, rows.shape[1]), np.nan),
            rows,
            np.full((after, rows.shape[1]), np.nan),
        ]
    )
    beyond = np.ones(len(padded), dtype=bool)
    beyond[before : len(padded) - after] = False
    slide = np.lib.stride_tricks.sliding_window_view
    view = slide(padded, chunk + 2 * margin, axis=0)[::chunk]
    return np.ascontiguousarray(view.swapaxes(1, 2)), slide(beyond, chunk + 2 * margin)[::chunk]


@functools.lru_cache(maxsize=16)
def _sections(
    settings: ConditionSettings, rate_hz: float
) -> Float[np.ndarray, "section 6"] | None:
    """Filter of the band and, where samples are thinned out, against aliases."""
    nyquist = rate_hz / 2
    parts: list[Float[np.ndarray, "section 6"]] = []
    edges: tuple[tuple[Literal["highpass", "lowpass"], float | None], ...] = (
        ("highpass", settings.highpass_hz),
        ("lowpass", settings.lowpass_hz),
    )
    for kind, edge in edges:
        if edge is None:
            continue
        if edge >= nyquist:
            raise ValueError(
                f"condition.{kind}_hz={edge} is not below {nyquist:g} Hz, half of the sampling "
                f"rate. Lower {kind}_hz, or sample faster."
            )
        parts.append(butterworth(settings.order, edge / nyquist, kind))
    if settings.decimate > 1:
        parts.append(chebyshev(8, 0.05, 0.8 / settings.decimate))
    return np.concatenate(parts) if parts else None

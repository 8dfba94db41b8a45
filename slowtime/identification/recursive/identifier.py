"""Recursive identification of all modes in an endless stream of blocks."""

import dataclasses
import functools
import itertools
import math

import numpy as np
from jaxtyping import Float

from slowtime.identification import checks
from slowtime.identification.modes import Mode
from slowtime.identification.subspace.bands import CORE, EDGE, Passband, plan_bands

from .band import BandState, BandStep
from .band_solution import ModelSizes, join_bands
from .forgetting import FrequencyGrid
from .frames import BinRange
from .sample_buffer import SampleBuffer

TOP = 0.95 * EDGE
"""Upper end of the raster of bands, as of records read whole, relative to half the sampling
rate [1]."""

FEWEST_CYCLES = 50
"""Shortest memory [cycles of the lowest frequency]."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class RecursiveState:
    """What is kept of a stream.

    Parameters
    ----------
    tail
        Last samples, as far back as a frame still needs them.
    lost
        Samples known to be missing.
    bands
        State of each band.
    modes
        As they are known by now, ascending in frequency.
    """

    tail: SampleBuffer
    lost: int
    bands: tuple[BandState, ...]
    modes: tuple[Mode, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class RecursiveModes:
    """Modes of an endless stream.

    Parameters
    ----------
    rate_hz
        Samples per second [Hz].
    band_hz
        Of the modes that are reported [Hz]; a mode does not depend on where its edges are. The
        lower edge sets how much is kept of the samples, 70 to 100 of its cycles, and the delay,
        35 to 50.
    memory_s
        Time in which old samples lose their weight by e [s]; None forgets nothing.
    every_s
        A band is solved no more often than this [s], and after each of its frames at most.
    rows, order, most_directions
        Block rows, highest order and combinations of channels of the subspace models.
    """

    rate_hz: float
    band_hz: tuple[float, float]
    memory_s: float | None = None
    every_s: float = 60.0
    rows: int = 12
    order: int = 20
    most_directions: int = 8

    def __post_init__(self) -> None:
        low, high = self.band_hz
        if not 0 < low < high < EDGE * self.rate_hz / 2:
            raise ValueError(
                f"band_hz=({low:g}, {high:g}) is not a band between 0 and "
                f"{EDGE * self.rate_hz / 2:g} Hz, nearly half the sampling rate. Give "
                f"0 < low < high < {EDGE * self.rate_hz / 2:g} Hz, or sample faster."
            )
        if self.memory_s is not None and not self.memory_s * low >= FEWEST_CYCLES:
            raise ValueError(
                f"memory_s={self.memory_s:g} holds {self.memory_s * low:.0f} cycles of the "
                f"lowest frequency. Give at least {FEWEST_CYCLES / low:g} s, or a higher band."
            )

    @property
    def bands(self) -> tuple[Passband, ...]:
        """Bands whose cores follow each other over the whole of `band_hz` and a little more."""
        return tuple(step.band for step in _steps(self))

    def start(self) -> RecursiveState:
        """Nothing seen yet."""
        return RecursiveState(SampleBuffer(), 0, tuple(BandState() for _ in self.bands))

    def step(
        self,
        state: RecursiveState,
        block: Float[np.ndarray, "time channel"],
        *,
        first_index: int | None = None,
    ) -> tuple[RecursiveState, tuple[Mode, ...]]:
        """Process one block of any length; return all modes as they are known by then.

        Parameters
        ----------
        block
            Samples that follow each other, any units. A row with a NaN counts as lost.
        first_index
            Of the first row in the stream, lost samples counted; by default right after the
            last block. What lies between is lost.
        """
        if first_index is not None:
            state = self._after_gap(state, first_index)
        for begin, end, present in _runs(np.isfinite(block).all(axis=1)):
            if present:
                state = self._taken_in(state, block[begin:end])
            else:
                state = self._after_gap(state, state.tail.next_index + end - begin)
        return state, state.modes

    def solved(self, state: RecursiveState) -> tuple[Mode, ...]:
        """Modes by all data so far, whether or not a solution is due."""
        steps = zip(_steps(self), state.bands, strict=True)
        return self._reported([(step.band, step.solved(band)) for step, band in steps])

    def _reported(self, solved: list[tuple[Passband, tuple[Mode, ...]]]) -> tuple[Mode, ...]:
        """Modes of all bands within the band that is asked for."""
        return tuple(
            mode
            for mode in join_bands(solved)
            if checks.is_inside(mode.frequency_hz.value, self.band_hz)
        )

    def _after_gap(self, state: RecursiveState, index: int) -> RecursiveState:
        lost = index - state.tail.next_index
        if lost < 0:
            raise ValueError(
                f"A block from index {index} was given after {state.tail.next_index} samples; "
                f"the next index is {state.tail.next_index} or, after a gap, larger. Give each "
                "sample once, and in order."
            )
        if lost == 0:
            return state
        return dataclasses.replace(
            state,
            tail=SampleBuffer(first_index=index),
            lost=state.lost + lost,
            bands=tuple(
                step.after_gap(band, index)
                for step, band in zip(_steps(self), state.bands, strict=True)
            ),
        )

    def _taken_in(self, state: RecursiveState, rows: np.ndarray) -> RecursiveState:
        tail = state.tail.extended(rows)
        bands, solved = [], False
        for step, band in zip(_steps(self), state.bands, strict=True):
            last_due = None
            while band.next_frame + step.frame.length <= tail.next_index:
                samples = tail.rows(band.next_frame, step.frame.length)
                band, due = step.step(band, samples)
                last_due = band if due else last_due
            if last_due is not None:
                band = dataclasses.replace(band, modes=step.solved(last_due))
                solved = True
            bands.append(band)
        modes = state.modes
        if solved:
            modes = self._reported(
                [(b, s.modes) for b, s in zip(self.bands, bands, strict=True)]
            )
        needed = min(band.next_frame for band in bands)
        return RecursiveState(tail.from_index(needed), state.lost, tuple(bands), modes)


@functools.lru_cache(maxsize=64)
def _steps(settings: RecursiveModes) -> tuple[BandStep, ...]:
    models = ModelSizes(
        rows=settings.rows, order=settings.order, most_directions=settings.most_directions
    )
    steps = []
    for band in _fixed_bands(settings):
        frame = BinRange.of(band, settings.rate_hz)
        every = max(1, math.ceil(settings.every_s / frame.hop_s))
        steps.append(BandStep(band, FrequencyGrid(frame), models, settings.memory_s, every))
    return tuple(steps)


def _fixed_bands(settings: RecursiveModes) -> list[Passband]:
    """Bands of a raster that hangs on the rate alone, as far as they overlap `band_hz`."""
    # So a mode is found in the same band wherever the edges of `band_hz` are.
    low, high = settings.band_hz
    edges = [TOP * settings.rate_hz / 2]
    while edges[-1] > low:
        edges.append(edges[-1] / CORE)
    edges[0] = max(edges[0], high)
    return [
        band
        for lower, upper in itertools.pairwise(reversed(edges))
        if upper > low and lower < high
        # Rounding must not make two bands of one.
        for band in plan_bands(lower * (1 + 1e-9), upper, settings.rate_hz, resolution_hz=0.0)
    ]


def _runs(present: np.ndarray) -> list[tuple[int, int, bool]]:
    """Begin, end and whether they are there, of rows that are alike."""
    if not len(present):
        return []
    edges = [0, *(np.flatnonzero(np.diff(present)) + 1).tolist(), len(present)]
    return [(a, b, bool(present[a])) for a, b in itertools.pairwise(edges)]

"""First stage of the edge: a source in, admitted blocks out.

A source is anything that can be iterated for blocks; it yields None where an epoch is complete
and nothing more of it will come, so that its features need not wait for the next one. A device
is one too: a class with `time_base`, `slow_time_unit` and an `__iter__` that yields `Block`s of
its own sample type, stamped with its own clock, ``first_index`` counting lost samples too.
"""

import dataclasses
import logging
import threading
from collections.abc import Iterator
from typing import Protocol, runtime_checkable

import numpy as np

from slowtime.signals.block import Block
from slowtime_schemas.messages import TimeBase
from slowtime_schemas.raw import RawHeader
from slowtime_services.clock import Clock
from slowtime_services.files import ALL, UNDATED_NS, read_record
from slowtime_services.replay import raw_blocks

from .settings import (
    AdmissionSettings,
    FileInput,
    Input,
    RecordingInput,
    SimulatedInput,
)

logger = logging.getLogger(__name__)

ADOPT_AFTER = 10
"""So many refused blocks in a row that agree with each other are a stream that has changed."""


@runtime_checkable
class Source(Protocol):
    """Where samples come from."""

    @property
    def time_base(self) -> TimeBase:
        """Whose clock stamps the blocks."""
        ...

    @property
    def slow_time_unit(self) -> str:
        """Unit of `Block.slow_time`."""
        ...

    def __iter__(self) -> Iterator[Block | None]:
        """Blocks in order; None where an epoch is complete."""
        ...


class Pacer:
    """Waits until a moment of the stream has come, and no longer than until `stop`."""

    def __init__(self, clock: Clock, stop: threading.Event) -> None:
        self._clock, self._stop = clock, stop
        self._began_ns = clock.now_ns()

    def wait_until(self, seconds: float) -> bool:
        """Return once `seconds` have passed since the start; False if stopped before."""
        while not self._stop.is_set():
            left = seconds - (self._clock.now_ns() - self._began_ns) / 1e9
            if left <= 0:
                return True
            self._clock.sleep(min(left, 0.1))
        return False


@dataclasses.dataclass(frozen=True, slots=True)
class SimulatedSource:
    """Epochs of a structure that exists in software only."""

    settings: SimulatedInput
    pacer: Pacer
    time_base: TimeBase = "simulated"

    @property
    def slow_time_unit(self) -> str:
        """Unit of slow time."""
        return self.settings.structure.slow_time_unit

    def __iter__(self) -> Iterator[Block | None]:
        """One epoch every `every_s`."""
        structure, number = self.settings.structure, self.settings.first_epoch
        due = 0.0
        while structure.epochs is None or number < structure.epochs:
            if not self.pacer.wait_until(due):
                return
            yield from structure.epoch(number)
            yield None
            number += 1
            due += self.settings.every_s


@dataclasses.dataclass(frozen=True, slots=True)
class FileSource:
    """A table of measurements as one continuous stream."""

    settings: FileInput
    pacer: Pacer
    covariates: tuple[str, ...] = ()
    """Channels that are kept though they may never change, as a temperature may."""
    time_base: TimeBase = "recorded"
    slow_time_unit: str = "s"

    def __iter__(self) -> Iterator[Block | None]:
        """Blocks of `block_s`."""
        given = self.settings
        record = read_record(
            given.path,
            rate_hz=given.rate_hz,
            channels=given.channels,
            skip_lines=given.skip_lines,
            columns=given.columns,
            time_column=given.time_column,
            time_unit=given.time_unit,
            wrapped=given.wrapped,
            keep=given.keep if ALL in given.keep else (*given.keep, *self.covariates),
            units=given.units,
            sensitivities=given.sensitivities,
            keep_missing=True,
        )
        for said in (*record.notes, *record.assumptions):
            logger.info("%s: %s", given.path, said)
        begins_ns = record.start_ns if given.start_ns is None else given.start_ns
        if begins_ns is None:
            begins_ns = UNDATED_NS
            logger.warning(
                "%s does not say when it began; 2000-01-01 is put there. Set input.start_ns.",
                given.path,
            )
        blocks = record.blocks(given.block_s, start_ns=begins_ns)
        yield from _paced(blocks, given.speed, self.pacer)


@dataclasses.dataclass(frozen=True, slots=True)
class RecordingSource:
    """Raw blocks of one asset in an MCAP recording, epochs and all."""

    settings: RecordingInput
    pacer: Pacer
    time_base: TimeBase = "recorded"

    @property
    def slow_time_unit(self) -> str:
        """Unit that the first recorded block states."""
        return next(header.slow_time_unit for header, _ in self._recorded())

    def __iter__(self) -> Iterator[Block | None]:
        """Blocks as they were recorded."""
        blocks = (block for _, block in self._recorded())
        yield from _paced(blocks, self.settings.speed, self.pacer)

    def _recorded(self) -> Iterator[tuple[RawHeader, Block]]:
        given = self.settings
        return raw_blocks(given.path, site=given.site, asset=given.asset)


def open_source(
    settings: Input, clock: Clock, stop: threading.Event, covariates: tuple[str, ...] = ()
) -> Source:
    """Open the source that the settings name, with the covariates among its channels."""
    pacer = Pacer(clock, stop)
    if isinstance(settings, SimulatedInput):
        return SimulatedSource(settings, pacer)
    if isinstance(settings, FileInput):
        return FileSource(settings, pacer, covariates=covariates)
    return RecordingSource(settings, pacer)


def _paced(blocks: Iterator[Block], speed: float, pacer: Pacer) -> Iterator[Block]:
    """Hand a block over when its last sample would have been taken."""
    first_ns: int | None = None
    for block in blocks:
        first_ns = block.start_ns if first_ns is None else first_ns
        if not pacer.wait_until((block.end_ns - first_ns) / 1e9 / speed if speed else 0.0):
            return
        yield block


@dataclasses.dataclass(frozen=True, slots=True)
class AdmissionState:
    """Last block that was let in, and those that were refused since and agree."""

    last: Block | None = None
    suspect: Block | None = None
    agreeing: int = 0


@dataclasses.dataclass(frozen=True, slots=True)
class Refusal:
    """Why a block was not let in: a word to count by, and a sentence."""

    word: str
    sentence: str


@dataclasses.dataclass(frozen=True, slots=True)
class Admission:
    """Let blocks in that continue the stream; refuse, with a reason, those that cannot.

    A sensor may also have changed for good, after a restart say. So `ADOPT_AFTER` refused
    blocks in a row that continue each other are taken for the stream from then on.
    """

    settings: AdmissionSettings
    time_base: TimeBase = "live"

    def start(self) -> AdmissionState:
        """Begin with any stream welcome."""
        return AdmissionState()

    def step(
        self, state: AdmissionState, block: Block, now_ns: int
    ) -> tuple[AdmissionState, Refusal | None]:
        """Judge one block; None says that it is let in."""
        unfit = self._unfit(block, now_ns)
        if unfit is not None:
            return state, unfit
        if state.last is None or (refusal := self._contradicts(block, state.last)) is None:
            return AdmissionState(last=_without_samples(block)), None
        agrees = state.suspect is not None and not self._contradicts(block, state.suspect)
        agreeing = state.agreeing + 1 if agrees else 1
        if agreeing >= ADOPT_AFTER:
            return AdmissionState(last=_without_samples(block)), None
        return AdmissionState(state.last, _without_samples(block), agreeing), refusal

    def _unfit(self, block: Block, now_ns: int) -> Refusal | None:
        """Why no stream could hold this block."""
        if block.samples.size == 0:
            return Refusal("empty", "It has no samples.")
        if not np.isfinite(block.samples).any():
            return Refusal("not_finite", "None of its samples is finite. Check the sensor.")
        ahead_s = (block.start_ns - now_ns) / 1e9
        if self.time_base == "live" and ahead_s > self.settings.max_ahead_s:
            return Refusal(
                "future",
                f"Its time is {ahead_s:.0f} s ahead of ours; {self.settings.max_ahead_s:g} s "
                "are allowed. Set the sensor's clock, or raise admission.max_ahead_s.",
            )
        behind = self.settings.max_behind_s
        if self.time_base == "live" and behind is not None and -ahead_s > behind:
            return Refusal(
                "stale",
                f"Its time is {-ahead_s:.0f} s behind ours; {behind:g} s are allowed. Set the "
                "sensor's clock, or raise admission.max_behind_s.",
            )
        return None

    def _contradicts(self, block: Block, last: Block) -> Refusal | None:
        """Why this block cannot come after `last`."""
        for word, ours, given in (
            ("wrong_rate", last.rate_hz, block.rate_hz),
            ("wrong_channels", last.channels, block.channels),
            ("wrong_units", last.units, block.units),
            ("wrong_type", last.samples.dtype.str, block.samples.dtype.str),
        ):
            if ours != given:
                return Refusal(word, f"{given!r} was given in a stream of {ours!r}.")
        if block.first_index < last.next_index:
            return Refusal(
                "backwards",
                f"It begins at sample {block.first_index}, the stream is already at "
                f"{last.next_index}: a block twice, or out of order.",
            )
        return self._jumps(block, last)

    def _jumps(self, block: Block, last: Block) -> Refusal | None:
        lost = block.first_index - last.next_index
        expected = last.end_ns + round(lost * 1e9 / block.rate_hz)
        late_s = (block.start_ns - expected) / 1e9
        tolerance = self.settings.clock_tolerance_s
        if block.epoch != last.epoch:
            jumped = block.start_ns < last.end_ns - tolerance * 1e9
        else:
            jumped = abs(late_s) > tolerance
        if not jumped:
            return None
        return Refusal(
            "clock_jump",
            f"Its time is {late_s:+.3f} s from what the samples before it say; "
            f"{tolerance:g} s are allowed. Let the sensor's clock run steadily.",
        )


def _without_samples(block: Block) -> Block:
    """Only the extent of a block, so that the state does not keep its samples alive."""
    shape, kind = block.samples.shape, block.samples.dtype
    empty = np.broadcast_to(np.zeros((), kind), shape)
    return dataclasses.replace(block, samples=empty)

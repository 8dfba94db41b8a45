"""The protocol of a source of samples, and the pace of sources that are not live."""

import threading
from collections.abc import Iterator, Mapping
from typing import Protocol, runtime_checkable

from slowtime.signals.block import Block
from slowtime_schemas.messages import TimeBase
from slowtime_services.clock import Clock

LONGEST_PAUSE_S = 3600.0
"""Longest pause between two blocks of a file [s], whatever their times say: those of a logger
whose clock was set meanwhile are decades apart."""


@runtime_checkable
class BlockSource(Protocol):
    """A source of blocks of samples."""

    @property
    def time_base(self) -> TimeBase:
        """The kind of clock that stamps the blocks."""
        ...

    @property
    def slow_time_unit(self) -> str:
        """Unit of `Block.slow_time`."""
        ...

    def __iter__(self) -> Iterator[Block | None]:
        """Blocks in order; None where an epoch is complete."""
        ...


@runtime_checkable
class CountingSource(Protocol):
    """A source that counts its events."""

    def counts(self) -> Mapping[str, int]:
        """Counters of `Health`; may be called from any thread."""
        ...


class Pacer:
    """Waits until a moment of the stream has come, and no longer than until `stop`."""

    def __init__(self, clock: Clock, stop: threading.Event) -> None:
        self._clock, self._stop = clock, stop
        self._began_ns = clock.elapsed_ns()

    @property
    def elapsed_s(self) -> float:
        """Time since the start [s]."""
        return (self._clock.elapsed_ns() - self._began_ns) / 1e9

    def wait_until(self, seconds: float) -> bool:
        """Return once `seconds` have passed since the start; False if stopped before."""
        while not self._stop.is_set():
            left = seconds - self.elapsed_s
            if left <= 0:
                return True
            self._clock.sleep(min(left, 0.1))
        return False


def paced(blocks: Iterator[Block], speed: float, pacer: Pacer) -> Iterator[Block]:
    """Yield each block when its last sample would have been taken.

    `speed` is the pace as a multiple of real time, 0 for no wait; it ends where stopped.
    """
    due_s, before_ns = 0.0, None
    for block in blocks:
        since_ns = block.start_ns if before_ns is None else before_ns
        pause_s = max(0, block.end_ns - since_ns) / 1e9 / speed if speed else 0.0
        due_s, before_ns = due_s + min(pause_s, LONGEST_PAUSE_S), block.end_ns
        if not pacer.wait_until(due_s):
            return
        yield block

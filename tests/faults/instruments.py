"""What the harness puts into a process through its front door: a clock, a source, a ledger."""

import dataclasses
import mmap
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from edge_agent.publish import Spool
from slowtime.signals.block import Block
from slowtime_schemas.messages import TimeBase
from slowtime_services.simulate import SimulatedStructure

_VALUE = struct.Struct("<d")
STRUCTURE = {"frequency_hz": 40.0, "seconds": 0.25, "interval_s": 0.25, "rate_hz": 512.0}


class Dial:
    """A number that the harness turns and a process reads, in a file both have mapped."""

    def __init__(self, path: Path, value: float | None = None) -> None:
        if value is not None:
            path.write_bytes(_VALUE.pack(value))
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), _VALUE.size)

    @property
    def value(self) -> float:
        """Where it stands."""
        return float(_VALUE.unpack(self._map[:])[0])

    @value.setter
    def value(self, value: float) -> None:
        self._map[:] = _VALUE.pack(value)


class SkewedClock:
    """The machine's clock, so many seconds off."""

    def __init__(self, off_s: Dial) -> None:
        self._off_s = off_s

    def now_ns(self) -> int:
        """Wrong time."""
        return time.time_ns() + round(self._off_s.value * 1e9)

    def sleep(self, seconds: float) -> None:
        """Sleep as usual."""
        time.sleep(max(seconds, 0.0))

    def elapsed_ns(self) -> int:
        """Time that no dial changes."""
        return time.monotonic_ns()


@dataclasses.dataclass(frozen=True, slots=True)
class FaultySource:
    """A simulated structure that is listened to as often as a dial says, 0 for not at all.

    Parameters
    ----------
    first_epoch
        Goes on where the life of the process before has ended.
    """

    clock: SkewedClock
    rate_hz: Dial
    stop: Any
    first_epoch: int
    seed: int
    time_base: TimeBase
    slow_time_unit: str = "d"

    def __iter__(self) -> Iterator[Block | None]:
        """One epoch after another."""
        structure = SimulatedStructure(**STRUCTURE, seed=self.seed)
        number, due_s = self.first_epoch, time.monotonic()
        while not self.stop.is_set():
            rate_hz = self.rate_hz.value
            if rate_hz <= 0 or time.monotonic() < due_s:
                self.stop.wait(0.02 if rate_hz <= 0 else min(due_s - time.monotonic(), 0.05))
                continue
            blocks = list(structure.epoch(number))
            off_ns = self.clock.now_ns() - blocks[-1].end_ns if self.time_base == "live" else 0
            for block in blocks:
                yield dataclasses.replace(block, start_ns=block.start_ns + off_ns)
            yield None
            number += 1
            due_s = max(due_s + 1.0 / rate_hz, time.monotonic() - 2.0)


def ledger_spool(ledger: Any) -> type[Spool]:
    """Make a spool that tells the harness what it is given, and what it has taken."""

    class LedgerSpool(Spool):
        def append(self, sequence: int, payload: bytes) -> None:
            ledger.send_bytes(b"M" + payload)
            super().append(sequence, payload)
            ledger.send_bytes(b"K" + payload)

    return LedgerSpool

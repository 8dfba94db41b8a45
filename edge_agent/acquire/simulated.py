"""Blocks of a structure that exists in software only."""

import dataclasses
from collections.abc import Iterator

from edge_agent.settings import SimulatedInput
from slowtime.signals.block import Block
from slowtime_schemas.messages import TimeBase

from .source import Pacer

HELD_S = 0.1
"""Interval at which a held calendar is looked at again [s]."""


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
        """One epoch every `every_s`; none while the calendar is held."""
        structure, number = self.settings.structure, self.settings.first_epoch
        due = 0.0
        while structure.epochs is None or number < structure.epochs:
            if not self.pacer.wait_until(due):
                return
            while self._held:
                due = self.pacer.elapsed_s + HELD_S  # what was held is not caught up with
                if not self.pacer.wait_until(due):
                    return
            yield from structure.epoch(number)
            yield None
            number += 1
            due += self.settings.every_s

    @property
    def _held(self) -> bool:
        hold = self.settings.hold
        return hold is not None and hold.exists()

"""Blocks of a structure that exists in software only."""

import dataclasses
from collections.abc import Iterator

from edge_agent.settings import SimulatedInput
from slowtime.signals.block import Block
from slowtime_schemas.messages import TimeBase

from .source import Pacer


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

"""Raw blocks of an MCAP recording."""

import dataclasses
import logging
from collections.abc import Iterator

import numpy as np

from edge_agent.settings import RecordingInput
from slowtime.signals.block import Block
from slowtime_schemas.messages import TimeBase
from slowtime_schemas.raw import RawHeader
from slowtime_services.files.channels.si_conversion import Scaling, scaling_of

from .source import Pacer, paced

logger = logging.getLogger(__name__)


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
        """Blocks as they were recorded, or in the units that were given."""
        blocks: Iterator[Block] = (block for _, block in self._recorded())
        if self.settings.units or self.settings.sensitivities:
            blocks = self._in_si(blocks)
        yield from paced(blocks, self.settings.speed, self.pacer)

    def _in_si(self, blocks: Iterator[Block]) -> Iterator[Block]:
        """Turn blocks into SI by the units that were given."""
        known: dict[tuple[tuple[str, ...], tuple[str, ...]], Scaling] = {}
        for block in blocks:
            key = block.channels, block.units
            if key not in known:
                known[key] = scaling_of(*key, self.settings.units, self.settings.sensitivities)
                for said in known[key].notes:
                    logger.info("%s: %s", self.settings.path, said)
            samples = block.samples * np.array(known[key].factors)
            yield dataclasses.replace(block, samples=samples, units=known[key].units)

    def _recorded(self) -> Iterator[tuple[RawHeader, Block]]:
        from slowtime_services.replay import raw_blocks  # here: only this input needs MCAP

        given = self.settings
        return raw_blocks(given.path, site=given.site, asset=given.asset)

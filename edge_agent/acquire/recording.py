"""Raw blocks of an MCAP recording."""

import dataclasses
from collections.abc import Iterator

from edge_agent.settings import RecordingInput
from slowtime.signals.block import Block
from slowtime_schemas.messages import TimeBase
from slowtime_schemas.raw import RawHeader

from .source import Pacer, paced


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
        yield from paced(blocks, self.settings.speed, self.pacer)

    def _recorded(self) -> Iterator[tuple[RawHeader, Block]]:
        from slowtime_services.replay import raw_blocks  # here: only this input needs MCAP

        given = self.settings
        return raw_blocks(given.path, site=given.site, asset=given.asset)

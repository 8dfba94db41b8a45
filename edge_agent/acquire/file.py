"""Blocks of a table of measurements."""

import dataclasses
import logging
from collections.abc import Iterator

from edge_agent.settings import FileInput
from slowtime.signals.block import Block
from slowtime_schemas.messages import TimeBase

from .source import Pacer, paced

logger = logging.getLogger(__name__)


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
        from slowtime_services.files import ALL, UNDATED_NS, read_record

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
            repeated=given.repeated,
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
                "%s does not state its start; 2000-01-01 is assumed. Set input.start_ns.",
                given.path,
            )
        blocks = record.blocks(given.block_s, start_ns=begins_ns)
        yield from paced(blocks, given.speed, self.pacer)

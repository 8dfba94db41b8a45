"""A killed recorder's file in, a sound one out, with everything that can be read."""

import collections
import dataclasses
import logging
import os
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    Header,
    McapRecord,
    Message,
    Metadata,
    Schema,
)
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC, Writer

from .chunks import plain

logger = logging.getLogger(__name__)

LARGEST_RECORD = 2**30


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Recovered:
    """What was kept of a damaged recording."""

    messages: int
    counts: dict[str, int]
    """Messages kept, by topic."""
    first_ns: int | None
    last_ns: int | None
    damaged_chunks: int
    """Chunks whose check sum or compression was wrong; their messages are lost."""
    unread_bytes: int
    """Bytes at the end that could not be read: at most what was being written."""
    was_sound: bool
    """Whether there was nothing to do."""


class _Salvage:
    """The new file, and what has gone into it."""

    def __init__(self, file: BinaryIO) -> None:
        self._writer = Writer(file)
        self._started = False
        self._schemas: dict[int, int] = {0: 0}
        self._channels: dict[int, tuple[int, str]] = {}
        self.counts: collections.Counter[str] = collections.Counter()
        self.times: tuple[int, int] | None = None
        self.damaged_chunks = 0
        self.read_to = 0
        self.complete = False

    def keep(self, record: McapRecord) -> None:
        """Write again what a reader gave, whatever it is; indexes are made anew."""
        match record:
            case Header():
                self._writer.start(record.profile, record.library)
                self._started = True
            case Schema() if record.id not in self._schemas:
                self._schemas[record.id] = self._writer.register_schema(
                    record.name, record.encoding, record.data
                )
            case Channel() if record.id not in self._channels:
                number = self._writer.register_channel(
                    record.topic,
                    record.message_encoding,
                    self._schemas.get(record.schema_id, 0),
                    record.metadata,
                )
                self._channels[record.id] = (number, record.topic)
            case Message() if record.channel_id in self._channels:
                self._keep_message(record)
            case Metadata():
                self._writer.add_metadata(record.name, record.metadata)
            case Attachment():
                self._writer.add_attachment(
                    record.create_time,
                    record.log_time,
                    record.name,
                    record.media_type,
                    record.data,
                )
            case _:
                pass

    def finish(self) -> None:
        if not self._started:
            self._writer.start()
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _keep_message(self, message: Message) -> None:
        number, topic = self._channels[message.channel_id]
        self._writer.add_message(
            number, message.log_time, message.data, message.publish_time, message.sequence
        )
        self.counts[topic] += 1
        first, last = self.times or (message.log_time, message.log_time)
        self.times = min(first, message.log_time), max(last, message.log_time)


def recover(path: Path | str, out: Path | str) -> Recovered:
    """Write to `out` a sound, indexed recording with all that can be read of `path`.

    Raises
    ------
    ValueError
        If `path` is no MCAP file at all.
    FileExistsError
        If `out` exists.
    """
    path, out = Path(path), Path(out)
    if out.exists():
        raise FileExistsError(
            f"{out} exists. Give another name; what is damaged is kept until you delete it."
        )
    partial = out.with_name(out.name + ".partial")
    try:
        with path.open("rb") as damaged, partial.open("wb") as file:
            _check_magic(path, damaged)
            salvage = _Salvage(file)
            for record in _readable(damaged, salvage):
                salvage.keep(record)
            salvage.finish()
        os.replace(partial, out)
    finally:
        partial.unlink(missing_ok=True)
    first, last = salvage.times or (None, None)
    return Recovered(
        messages=salvage.counts.total(),
        counts=dict(salvage.counts),
        first_ns=first,
        last_ns=last,
        damaged_chunks=salvage.damaged_chunks,
        unread_bytes=path.stat().st_size - salvage.read_to,
        was_sound=salvage.complete and not salvage.damaged_chunks,
    )


def _check_magic(path: Path, file: BinaryIO) -> None:
    begins = file.read(len(MCAP0_MAGIC))
    file.seek(0)
    if begins != MCAP0_MAGIC:
        raise ValueError(
            f"{path} is no MCAP file: it begins with {begins!r}, an MCAP file with "
            f"{MCAP0_MAGIC!r}. There is nothing in it to recover."
        )


def _readable(file: BinaryIO, salvage: _Salvage) -> Iterator[McapRecord]:
    """Yield records, those inside chunks too, up to the end or to where the file breaks off."""
    records = StreamReader(file, emit_chunks=True, record_size_limit=LARGEST_RECORD).records
    while True:
        try:
            record = next(records)
        except StopIteration:
            salvage.read_to, salvage.complete = file.tell(), True
            return
        # Whatever the library stumbles over, what was read before it is worth keeping.
        except Exception as error:
            logger.info("Reading ends after %d bytes: %s", salvage.read_to, error)
            return
        if isinstance(record, Chunk):
            yield from _inside(record, salvage)
        else:
            yield record
        salvage.read_to = file.tell()


def _inside(chunk: Chunk, salvage: _Salvage) -> list[McapRecord]:
    try:
        return breakup_chunk(plain(chunk), validate_crc=True)
    except Exception as error:
        salvage.damaged_chunks += 1
        logger.warning("A chunk is damaged and left out: %s", error)
        return []

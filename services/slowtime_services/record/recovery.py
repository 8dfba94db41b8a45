"""Recovery of the readable records of a damaged recording."""

import collections
import dataclasses
import logging
import mmap
import os
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
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
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC, Writer

from slowtime_services.operating_system import same_file

from .chunks import Unpacking
from .fragments import fragment_of, whole_records, without_zeros
from .scanning import Broken, ByteRange, scan

logger = logging.getLogger(__name__)

_READERS = {
    Opcode.HEADER: Header.read,
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.METADATA: Metadata.read,
    Opcode.ATTACHMENT: Attachment.read,
}


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Recovered:
    """Messages kept of a damaged recording."""

    messages: int
    counts: dict[str, int]
    """Messages kept, by topic."""
    first_ns: int | None
    last_ns: int | None
    damaged_chunks: int
    """Chunks whose check sum or compression was wrong; their messages are lost."""
    torn_chunks: int
    """Chunks that were cut short, of which the messages that are whole were kept."""
    nameless: int
    """Messages left out because nothing says any more what channel they were on."""
    unread_bytes: int
    """Bytes that could not be read: mostly what was being written when the file broke off."""
    was_sound: bool
    """Whether there was nothing to do."""


class _Salvage:
    """The new file, and counts of its messages."""

    def __init__(self, file: BinaryIO) -> None:
        self._writer = Writer(file)
        self._started = False
        self._schemas: dict[int, int] = {0: 0}
        self._channels: dict[int, tuple[int, str]] = {}
        self.counts: collections.Counter[str] = collections.Counter()
        self.times: tuple[int, int] | None = None
        self.damaged_chunks = self.torn_chunks = self.nameless = 0
        self.unread_bytes = 0
        self.complete = True

    def keep(self, record: McapRecord) -> None:
        """Write the items that a reader returns; indexes are made again."""
        if not self._started:
            header = record if isinstance(record, Header) else Header("", "")
            self._writer.start(header.profile, header.library)
            self._started = True
        match record:
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
            case Message():
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
        if message.channel_id not in self._channels:
            self.nameless += 1
            return
        number, topic = self._channels[message.channel_id]
        self._writer.add_message(
            number, message.log_time, message.data, message.publish_time, message.sequence
        )
        self.counts[topic] += 1
        first, last = self.times or (message.log_time, message.log_time)
        self.times = min(first, message.log_time), max(last, message.log_time)


def recover(path: Path | str, out: Path | str) -> Recovered:
    """Write to `out` a sound, indexed recording of all that is readable in `path`.

    Raises
    ------
    ValueError
        If `path` is not a valid MCAP file at all.
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
            with mmap.mmap(damaged.fileno(), 0, access=mmap.ACCESS_READ) as data:
                for record in _named_at_the_end(damaged):
                    salvage.keep(record)
                for record in _readable(data, salvage):
                    salvage.keep(record)
            salvage.finish()
            file.flush()
            os.fsync(file.fileno())
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
        torn_chunks=salvage.torn_chunks,
        nameless=salvage.nameless,
        unread_bytes=salvage.unread_bytes,
        was_sound=salvage.complete and not salvage.damaged_chunks,
    )


def repack(path: Path) -> None:
    """Join the chunks of a sound recording to large ones, in place of the file at once.

    A recording that was flushed twice a second holds a chunk for each message or two, which
    take twenty times the room and the time to read. Messages, their order, times and numbers
    stay. A file that is damaged, or was moved or replaced meanwhile, is left as it is.
    """
    packed = path.with_name(path.name + ".repacked")
    try:
        with path.open("rb") as before:
            found = recover(path, packed)
            if found.was_sound and same_file(before.fileno(), path):
                os.replace(packed, path)
    finally:
        packed.unlink(missing_ok=True)


def _check_magic(path: Path, file: BinaryIO) -> None:
    begins = file.read(len(MCAP0_MAGIC))
    file.seek(0)
    if begins != MCAP0_MAGIC:
        raise ValueError(
            f"{path} is not a valid MCAP file: it begins with {begins!r}, an MCAP file with "
            f"{MCAP0_MAGIC!r}. There is nothing in it to recover."
        )


def _named_at_the_end(file: BinaryIO) -> Iterator[McapRecord]:
    """Yield header, schemas and channels that the index repeats, where it is whole.

    The chunk that named them first may be damaged.
    """
    try:
        reader = make_reader(file)
        summary = reader.get_summary()
        yield reader.get_header()
    # Whatever the library stumbles over: without an index there is nothing to say.
    except Exception:
        return
    if summary is not None:
        yield from summary.schemas.values()
        yield from summary.channels.values()


def _readable(data: mmap.mmap, salvage: _Salvage) -> Iterator[McapRecord]:
    """Yield records, those inside chunks too, past whatever is damaged."""
    unpacking = Unpacking(len(data))
    for piece in scan(data):
        if isinstance(piece, Broken):
            salvage.complete = False
            yield from _of_fragment(data[piece.begin : piece.end], salvage)
        elif piece.opcode == Opcode.CHUNK:
            yield from _inside(data, piece, salvage, unpacking)
        elif piece.opcode == Opcode.MESSAGE:
            body = ReadDataStream(BytesIO(data[piece.body]))
            yield Message.read(body, piece.end - piece.body.start)
        elif piece.opcode in _READERS:
            yield from _one(data, piece, salvage)


def _one(data: mmap.mmap, piece: ByteRange, salvage: _Salvage) -> list[McapRecord]:
    try:
        return [_READERS[Opcode(piece.opcode)](ReadDataStream(BytesIO(data[piece.body])))]
    except Exception as error:
        salvage.complete = False
        salvage.unread_bytes += piece.end - piece.begin
        logger.warning("A damaged record is left out: %s", error)
        return []


def _inside(
    data: mmap.mmap, piece: ByteRange, salvage: _Salvage, unpacking: Unpacking
) -> list[McapRecord]:
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(data[piece.body])))
        return breakup_chunk(unpacking.plain(chunk), validate_crc=True)
    except Exception as error:
        whole = data[piece.begin : piece.end]
        if piece.end == len(data) and len(without_zeros(whole)) < len(whole):
            salvage.complete = False
            return _of_fragment(without_zeros(whole), salvage)
        salvage.damaged_chunks += 1
        logger.warning("A damaged chunk is left out: %s", error)
        return []


def _of_fragment(data: bytes, salvage: _Salvage) -> list[McapRecord]:
    """Return the complete messages of a truncated chunk."""
    records: list[McapRecord] = []
    fragment = fragment_of(data)
    if fragment is not None:
        try:
            records.extend(whole_records(fragment))
        except Exception as error:
            logger.warning("A truncated chunk ends in damage: %s", error)
    if any(isinstance(record, Message) for record in records):
        salvage.torn_chunks += 1
    else:
        salvage.unread_bytes += len(data)
    return records

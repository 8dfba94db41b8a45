"""The writer of MCAP files; the same payloads give the same bytes."""

import collections
import contextlib
import importlib.metadata
import io
import itertools
import os
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO, Self

from mcap.writer import CompressionType, Writer

from slowtime_schemas.streams import Stream
from slowtime_services.operating_system import same_file

from .channels import describe

CHUNK_BYTES = 2**20
"""[bytes] After which a chunk ends, before compression. Source: the MCAP library's default;
a reader unpacks one in some milliseconds."""
CHUNK_NS = 10**9
"""Longest time that the messages of a chunk cover, those longer by themselves excepted."""
MOST_REPACKED = 200_000
"""[messages] Of a file that is repacked when it is closed. Source: it takes some 20 s;
`slowtime mcap recover` repacks any."""
MOST_CHANNELS = 2**16 - 1
"""Channels of a file, each a stream of an asset: MCAP numbers them with 16 bits, from 1."""
LIBRARY = "slowtime"
WINDOWS, COUNTED_ONCE = "windows", "counted once"
"""Rule by which twins of this version take in windows of the same time, in the metadata: a
recording without it was made where each boot's windows counted anew."""


def free_path(path: Path) -> Path:
    """Return `path`, or the first of `name-0001.mcap`, `name-0002.mcap`, … that is free."""
    numbered = (path.with_stem(f"{path.stem}-{number:04d}") for number in itertools.count(1))
    return next(free for free in itertools.chain([path], numbered) if not free.exists())


def software() -> str:
    """Name and version of the writing software."""
    return f"slowtime {importlib.metadata.version('slowtime')}"


class RecordingWriter:
    """An MCAP file being written.

    Chunks end after a mebibyte, a second of data, or at `flush`, never by a clock, so that an
    import writes the same bytes each time and a file that breaks off has lost a second at most;
    who records from a bus calls `flush` twice a second. Where that leaves many small chunks,
    `repack` joins them once the file is closed.

    Parameters
    ----------
    target
        A path that does not exist yet, or an open binary stream, which is left open.
    metadata
        Said of the recording in its metadata record, beside the software that wrote it.
    overwrite
        Whether an existing file may be replaced.
    """

    def __init__(
        self,
        target: Path | str | BinaryIO,
        *,
        metadata: Mapping[str, str] | None = None,
        overwrite: bool = False,
    ) -> None:
        self._file: BinaryIO
        self._owns_file = isinstance(target, Path | str)
        self._file = (
            _create(Path(target), overwrite) if isinstance(target, Path | str) else target
        )
        self._writer = Writer(
            self._file,
            chunk_size=CHUNK_BYTES,
            compression=CompressionType.ZSTD,
            enable_data_crcs=False,
        )
        self._channels: dict[tuple[str, str, str], int] = {}
        self._schemas: dict[str, int] = {}
        self._sequences: dict[int, int] = collections.defaultdict(int)
        self._counts: dict[str, int] = collections.defaultdict(int)
        self._chunk_ns: int | None = None
        """When the chunk that is being filled begins."""
        self._flushes = 0
        self._closed, self._bytes = False, 0
        self._writer.start(profile="", library=LIBRARY)
        self._writer.add_metadata(
            LIBRARY,
            {"software": software(), "layout": "1", WINDOWS: COUNTED_ONCE, **(metadata or {})},
        )
        self._file.flush()

    @property
    def counts(self) -> dict[str, int]:
        """Messages written so far, by stream."""
        return dict(self._counts)

    @property
    def bytes_written(self) -> int:
        """Bytes passed to the file."""
        return self._bytes if self._closed else self._file.tell()

    @property
    def is_worth_repacking(self) -> bool:
        """Whether flushes ended most chunks early, and there are not too many messages."""
        few = sum(self._counts.values()) <= MOST_REPACKED
        return few and self._flushes > 2 * (1 + self.bytes_written // CHUNK_BYTES)

    def has_room_for(self, stream: Stream, site: str, asset: str) -> bool:
        """Whether the file has, or can have, a channel of a stream of an asset."""
        known = (stream.name, site, asset) in self._channels
        return known or len(self._channels) < MOST_CHANNELS

    def write(
        self,
        stream: Stream,
        site: str,
        asset: str,
        payload: bytes,
        log_ns: int,
        publish_ns: int | None = None,
        *,
        until_ns: int | None = None,
    ) -> None:
        """Append one payload as it is.

        Parameters
        ----------
        log_ns
            When it arrived; of imported samples, the sensor's time of the first.
        publish_ns
            When it was sent, where known.
        until_ns
            When what it tells of ends, of samples that last.

        Raises
        ------
        ValueError
            If the file cannot have a channel more (see `has_room_for`).
        """
        if not self.has_room_for(stream, site, asset):
            raise ValueError(
                f"A recording has at most {MOST_CHANNELS} channels, one for each stream of "
                f"each asset; {site}.{asset} would need another. Begin another file."
            )
        self._begin_chunk(log_ns, log_ns if until_ns is None else until_ns)
        where = (stream.name, site, asset)
        channel = self._channels.get(where)
        if channel is None:
            channel = self._channels[where] = self._open_channel(stream, site, asset)
        sequence = self._sequences[channel]
        self._sequences[channel] = (sequence + 1) % 2**32
        self._counts[stream.name] += 1
        self._writer.add_message(
            channel_id=channel,
            log_time=log_ns,
            publish_time=log_ns if publish_ns is None else publish_ns,
            sequence=sequence,
            data=payload,
        )

    def flush(self, *, sync: bool = False) -> None:
        """Write everything to the operating system; with `sync`, to the disk.

        What has been flushed survives the end of this process, however it comes, and with
        `sync` the end of the power too.
        """
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._chunk_ns = None
        self._flushes += 1
        if sync:
            os.fsync(self._file.fileno())

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add metadata to the recording."""
        self._writer.add_metadata(name, dict(values))

    def in_place(self, path: Path) -> bool:
        """Whether `path` leads to the file that is written."""
        return same_file(self._file.fileno(), path)

    def close(self) -> bool:
        """Write the index and end the file; a second time does nothing, and says False."""
        if self._closed:
            return False
        self._closed = True
        try:
            counts = {name: str(count) for name, count in sorted(self._counts.items())}
            self._writer.add_metadata(f"{LIBRARY}.counts", counts)
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._file.flush()
            self._bytes = self._file.tell()
        finally:
            if self._owns_file:
                self._file.close()
        return True

    def abandon(self) -> None:
        """Leave the file without its index; `recover` makes it sound."""
        self._closed = True
        if self._owns_file:
            with contextlib.suppress(OSError):
                self._file.close()

    def __enter__(self) -> Self:
        """Return the writer."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()

    def _begin_chunk(self, log_ns: int, until_ns: int) -> None:
        """End the chunk where this message would make it longer than a second."""
        begins = self._chunk_ns
        if begins is not None and not (
            begins <= log_ns < begins + CHUNK_NS and until_ns <= begins + CHUNK_NS
        ):
            self.flush()
        if self._chunk_ns is None:
            self._chunk_ns = log_ns

    def _open_channel(self, stream: Stream, site: str, asset: str) -> int:
        description = describe(stream)
        name = description.schema_name
        if name not in self._schemas:
            self._schemas[name] = self._writer.register_schema(
                name, description.schema_encoding, description.schema
            )
        return self._writer.register_channel(
            stream.key(site, asset), description.message_encoding, self._schemas[name]
        )


def _create(path: Path, overwrite: bool) -> io.BufferedWriter:
    try:
        return path.open("wb" if overwrite else "xb")
    except FileExistsError as error:
        raise FileExistsError(
            f"{path} exists and may be the only copy of a recording. Give another name, or "
            "delete it first."
        ) from error
    except FileNotFoundError as error:
        raise FileNotFoundError(
            f"{path}: there is no folder {path.parent}. Make it first."
        ) from error

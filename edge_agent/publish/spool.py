"""Features on disk until the twin has them for good: appended, checked, bounded.

A folder of segment files, each of one boot. A file is named by the boot's place among all, by
its name and by its first sequence; no clock that was set back changes that place. It holds
eight bytes of mark, then records of

    length of payload (u32) · CRC-32 of sequence and payload (u32) · sequence (u64) · payload

little-endian. A write that a kill or a power cut tears leaves a tail whose checksum does not
hold; it is cut off when the folder is next opened, and everything before it stands.

Of a boot that has been dropped whole because the spool was full, the last sequence stays in
`dropped.json` until the twin acknowledges it: so that it can report what it never had.
"""

import dataclasses
import json
import logging
import os
import struct
import threading
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple

logger = logging.getLogger(__name__)

MARK = b"STSPOOL1"
RECORD = struct.Struct("<IIQ")
SUFFIX = ".spool"
DROPPED = "dropped.json"
MOST_DROPPED = 1_000
"""Boots dropped whole that are remembered; a device that reboots forever forgets the first."""
_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND


class SpoolError(OSError):
    """The spool cannot be used; the text says what to do."""


class Held(NamedTuple):
    """What the spool holds of one boot; `first` is one past `last` where all was dropped."""

    boot: str
    first: int
    last: int


@dataclasses.dataclass(slots=True)
class _Segment:
    path: Path
    boot: str
    first: int
    last: int
    count: int
    size: int


class Spool:
    """The features of one asset that may not be lost.

    Parameters
    ----------
    folder
        Where; made if it is not there. One process at a time may use it.
    boot
        Under which new features are kept.
    max_bytes
        Of all segments together; beyond, the oldest whole segment is dropped and counted.
    segment_bytes
        At which a new segment begins.
    fsync
        ``"always"``: each record, and the name of its file, is on the disk before `append`
        returns, so that a power cut loses nothing; ``"segment"``: each segment is when it is
        full, or closed; ``"never"``: when the system likes. What was appended survives the
        death of the process in any case.
    """

    def __init__(
        self,
        folder: Path,
        boot: str,
        *,
        max_bytes: int = 256 * 2**20,
        segment_bytes: int = 256 * 2**10,
        fsync: Literal["never", "segment", "always"] = "segment",
    ) -> None:
        self.folder, self.boot = folder, boot
        self._max_bytes, self._segment_bytes = max_bytes, segment_bytes
        self._fsync = fsync
        self._lock = threading.RLock()
        self._file: int | None = None
        self._dropped = 0
        self._last = -1
        folder.mkdir(parents=True, exist_ok=True)
        self._guard = _lock_folder(folder)
        self._gone = _read_dropped(folder / DROPPED)
        paths = sorted(folder.glob(f"*{SUFFIX}"), key=lambda path: (_place(path), path.name))
        self._place = 1 + max(map(_place, paths), default=0)
        self._segments = [segment for path in paths if (segment := _open(path))]
        self._size = sum(segment.size for segment in self._segments)
        if any(segment.boot == boot for segment in self._segments):
            _unlock(self._guard)
            raise SpoolError(
                f"{folder} already holds features of boot {boot!r}. Give each run its own boot "
                "id, or none, so that one is made."
            )

    @property
    def dropped(self) -> int:
        """How many features have been dropped unacknowledged because the spool was full."""
        return self._dropped

    @property
    def size(self) -> int:
        """Bytes in all segments."""
        return self._size

    @property
    def last_sequence(self) -> int:
        """Newest sequence appended in this boot; -1 before the first."""
        return self._last

    def held(self) -> tuple[Held, ...]:
        """List what is held of each boot, oldest boot first."""
        with self._lock:
            found = {boot: Held(boot, last + 1, last) for boot, last in self._gone.items()}
            for segment in self._segments:
                before = found.get(segment.boot)
                first = before.first if before else segment.first
                found[segment.boot] = Held(segment.boot, first, segment.last)
            return tuple(found.values())

    def append(self, sequence: int, payload: bytes) -> None:
        """Keep `payload`; when this returns, the death of the process does not lose it.

        Raises
        ------
        ValueError
            Where `sequence` does not grow.
        SpoolError
            Where the disk does not take it.
        """
        with self._lock:
            if sequence <= self._last:
                raise ValueError(
                    f"Sequence {sequence} was given after {self._last}. Sequences must grow."
                )
            record = _pack(sequence, payload)
            segment = self._room_for(sequence)
            try:
                _write_all(self._descriptor(), record)
                if self._fsync == "always":
                    os.fsync(self._descriptor())
            except OSError as error:
                self._cut_back(segment)
                raise SpoolError(
                    f"The spool {self.folder} does not take sequence {sequence}: {error}. "
                    "Make room on the disk, or lower spool.max_bytes."
                ) from error
            segment.last, segment.count = sequence, segment.count + 1
            segment.size += len(record)
            self._size += len(record)
            self._last = sequence
            self._drop_oldest()

    def read(self, boot: str, first: int = 0, last: int | None = None) -> Iterator[bytes]:
        """Give what is held of `boot` from `first` to `last`, in order."""
        with self._lock:
            wanted = [
                (segment.path, segment.size)
                for segment in self._segments
                if segment.boot == boot
                and segment.last >= first
                and (last is None or segment.first <= last)
            ]
        for path, size in wanted:
            try:
                data = path.read_bytes()[:size]
            except FileNotFoundError:  # acknowledged or dropped since
                continue
            for sequence, payload, _ in _records(data):
                if sequence >= first and (last is None or sequence <= last):
                    yield payload

    def acknowledge(self, boot: str, sequence: int) -> int:
        """Forget segments of `boot` that end by `sequence`; say how many features that was."""
        with self._lock:
            done = [s for s in self._segments if s.boot == boot and s.last <= sequence]
            for segment in done:
                self._remove(segment)
            if self._gone.get(boot, sequence + 1) <= sequence:
                del self._gone[boot]
                self._write_dropped()
            return sum(segment.count for segment in done)

    def close(self) -> None:
        """Bring everything to the disk and let go of the folder; a second time does nothing."""
        with self._lock:
            self._finish_segment()
            if self._guard is not None:
                _unlock(self._guard)
                self._guard = None

    def _descriptor(self) -> int:
        assert self._file is not None
        return self._file

    def _room_for(self, sequence: int) -> _Segment:
        current = self._segments[-1] if self._file is not None else None
        if current is not None and current.size < self._segment_bytes:
            return current
        path = self.folder / f"{self._place:08d}.{self.boot}.{sequence:020d}{SUFFIX}"
        try:
            self._finish_segment()
            self._file = self._begin(path)
        except OSError as error:
            raise SpoolError(
                f"The spool cannot write {path}: {error}. Make room on the disk, or point "
                "spool.folder elsewhere."
            ) from error
        segment = _Segment(path, self.boot, sequence, sequence, 0, len(MARK))
        self._segments.append(segment)
        self._size += segment.size
        return segment

    def _begin(self, path: Path) -> int:
        """Make a segment file; where the disk does not even take its mark, none is left."""
        file = os.open(path, _NEW, 0o644)
        try:
            _write_all(file, MARK)
            if self._fsync == "always":
                _sync_folder(self.folder)
        except OSError:
            os.close(file)
            path.unlink(missing_ok=True)
            raise
        return file

    def _finish_segment(self, *, keep: bool = True) -> None:
        if self._file is not None:
            file, self._file = self._file, None
            try:
                if keep and self._fsync != "never":
                    os.fsync(file)
                    _sync_folder(self.folder)
            finally:
                os.close(file)

    def _cut_back(self, segment: _Segment) -> None:
        """Take a torn record off again, so that the next one can be read after it."""
        try:
            os.ftruncate(self._descriptor(), segment.size)
        except OSError:
            self._finish_segment(keep=False)
        if segment.count == 0:
            self._remove(segment)

    def _drop_oldest(self) -> None:
        while self.size > self._max_bytes and len(self._segments) > 1:
            oldest = self._segments[0]
            self._dropped += oldest.count
            logger.warning(
                "The spool %s is full: features %d to %d of boot %s are dropped, unsent.",
                self.folder,
                oldest.first,
                oldest.last,
                oldest.boot,
            )
            self._remove(oldest)
            if not any(segment.boot == oldest.boot for segment in self._segments):
                self._gone[oldest.boot] = oldest.last
                for boot in list(self._gone)[:-MOST_DROPPED]:
                    del self._gone[boot]
                self._write_dropped()

    def _write_dropped(self) -> None:
        """Remember across a restart what was dropped whole; a full disk may prevent it."""
        path = self.folder / DROPPED
        try:
            path.with_suffix(".new").write_text(json.dumps(self._gone))
            path.with_suffix(".new").replace(path)
        except OSError:
            logger.exception("%s cannot be written; it is remembered until the end.", path)

    def _remove(self, segment: _Segment) -> None:
        if self._file is not None and segment is self._segments[-1]:
            self._finish_segment(keep=False)
        self._segments.remove(segment)
        self._size -= segment.size
        segment.path.unlink(missing_ok=True)


def _pack(sequence: int, payload: bytes) -> bytes:
    return RECORD.pack(len(payload), _checksum(sequence, payload), sequence) + payload


def _checksum(sequence: int, payload: bytes) -> int:
    return zlib.crc32(payload, zlib.crc32(sequence.to_bytes(8, "little")))


def _records(data: bytes) -> Iterator[tuple[int, bytes, int]]:
    """Sequence, payload and end of each sound record, up to the first that is not."""
    at = len(MARK)
    while at + RECORD.size <= len(data):
        length, check, sequence = RECORD.unpack_from(data, at)
        payload = data[at + RECORD.size : at + RECORD.size + length]
        if len(payload) < length or _checksum(sequence, payload) != check:
            return
        at += RECORD.size + length
        yield sequence, payload, at


def _place(path: Path) -> int:
    """Place of a segment's boot among all; 0 of software that did not name it."""
    place = path.name.partition(".")[0]
    return int(place) if len(place) == 8 and place.isdigit() else 0


def _open(path: Path) -> _Segment | None:
    """Look through a segment of an earlier run, and cut a torn tail off."""
    data = path.read_bytes()
    found = list(_records(data)) if data.startswith(MARK) else []
    end = found[-1][2] if found else 0
    if end < len(data):
        logger.warning(
            "%s: %d bytes after feature %s are torn and are cut off.",
            path.name,
            len(data) - max(end, len(MARK)),
            found[-1][0] if found else "none",
        )
    if not found:
        path.unlink()
        return None
    if end < len(data):
        os.truncate(path, end)
    boot = path.name.removesuffix(SUFFIX).rpartition(".")[0]
    if _place(path):
        boot = boot.partition(".")[2]
    return _Segment(path, boot, found[0][0], found[-1][0], len(found), end)


def _read_dropped(path: Path) -> dict[str, int]:
    try:
        return {str(boot): int(last) for boot, last in json.loads(path.read_text()).items()}
    except FileNotFoundError:
        return {}
    except (ValueError, TypeError, AttributeError) as error:
        logger.warning("%s cannot be read and is begun anew: %r", path, error)
        return {}


def _write_all(file: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(file, view) :]


def _lock_folder(folder: Path) -> int | None:
    """Keep a second agent out of the folder; the lock dies with the process."""
    file = os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o644)
    try:
        _try_lock(file)
    except OSError as error:
        os.close(file)
        raise SpoolError(
            f"The spool {folder} is in use by another edge agent. Stop that one, or give this "
            "one its own spool.folder."
        ) from error
    return file


def _unlock(file: int | None) -> None:
    if file is not None:
        os.close(file)


if os.name == "posix":
    import fcntl

    def _sync_folder(folder: Path) -> None:
        """Bring names of files to the disk: a new file without its name is lost."""
        file = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(file)
        finally:
            os.close(file)

    def _try_lock(file: int) -> None:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)

else:  # pragma: no cover

    def _sync_folder(folder: Path) -> None:
        """No such thing here: the system keeps names as it likes."""

    def _try_lock(file: int) -> None:
        """No such lock here: two agents in one folder are not noticed."""

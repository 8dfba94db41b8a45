"""Spools features on disk until the twin has acknowledged them.

A folder of segment files, each of one boot. A file is named by the boot's place among all, by
its name and by its first sequence; no clock that was set back changes that place. The
format of a file is described in `spool_records`.

A record may be torn by a power cut or damaged on the disk. The records before and after it stay
readable: the damaged bytes are set aside (see `damaged_bytes`), and the sequences that were in
them are told with the account, so that the twin reports them as lost.

Of a boot that has been dropped whole because the spool was full, the last sequence stays in
`dropped.json` until the twin acknowledges it: so that it can report what it never had.
"""

import dataclasses
import itertools
import json
import logging
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple

from slowtime_services.operating_system import same_file, sync_folder

from .damaged_bytes import DamagedBytes
from .segment_files import LOCK, NEW, SpoolError, lock_folder, unlock, write_all, written_again
from .spool_records import LARGEST_SEQUENCE, MARK, Damage, Sound, pack, scan

logger = logging.getLogger(__name__)

SUFFIX = ".spool"
DROPPED = "dropped.json"
WITHHELD = "withheld.json"
MOST_DROPPED = 1_000
"""Boots dropped whole that are remembered; a device that reboots forever forgets the first."""

TAKEN_AWAY = (FileNotFoundError, NotADirectoryError, IsADirectoryError)
"""What reading a segment fails with whose path leads nowhere, or to something else."""


class SpoolRange(NamedTuple):
    """Range of one boot in the spool; `first` is one past `last` where all was dropped."""

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
    acknowledged_s: float | None = None
    """Monotonic time at which all of it was acknowledged; None before."""


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
    keep_acknowledged_s
        How long acknowledged features stay, for a recorder that asks later than the twin [s].
    """

    def __init__(
        self,
        folder: Path,
        boot: str,
        *,
        max_bytes: int = 256 * 2**20,
        segment_bytes: int = 256 * 2**10,
        fsync: Literal["never", "segment", "always"] = "segment",
        keep_acknowledged_s: float = 0.0,
    ) -> None:
        self.folder, self.boot = folder, boot
        self._max_bytes, self._segment_bytes = max_bytes, segment_bytes
        self._fsync, self._keep_s = fsync, keep_acknowledged_s
        self._lock = threading.RLock()
        self._file: int | None = None
        self._dropped = 0
        self._last = -1
        folder.mkdir(parents=True, exist_ok=True)
        self._guard = lock_folder(folder)
        self._damaged = DamagedBytes(folder)
        self._gone = _read_dropped(folder / DROPPED)
        self._withheld = _read_dropped(folder / WITHHELD)
        paths = sorted(folder.glob(f"*{SUFFIX}"), key=lambda path: (_place(path), path.name))
        self._place = 1 + max(map(_place, paths), default=0)
        self._segments = [
            segment
            for path, following in itertools.zip_longest(paths, paths[1:])
            if (segment := _open(path, following, self._damaged))
        ]
        self._size = sum(segment.size for segment in self._segments)
        if any(segment.boot == boot for segment in self._segments):
            unlock(self._guard)
            raise SpoolError(
                f"{folder} already holds features of boot {boot!r}. Give each run its own boot "
                "id, or none, so that one is made."
            )
        # Torn records that a full disk has kept count now, and nothing else would make room.
        self._drop_oldest()

    @property
    def dropped(self) -> int:
        """Number of unacknowledged features dropped because the spool was full."""
        return self._dropped

    @property
    def damaged(self) -> int:
        """Number of features found damaged since the spool was opened."""
        return self._damaged.features

    @property
    def size(self) -> int:
        """Bytes in all segments."""
        return self._size

    @property
    def last_sequence(self) -> int:
        """Newest sequence appended in this boot; -1 before the first."""
        return self._last

    def held(self) -> tuple[SpoolRange, ...]:
        """List the stored features of each boot, oldest boot first."""
        with self._lock:
            found = {
                boot: SpoolRange(boot, last + 1, last) for boot, last in self._gone.items()
            }
            for segment in self._segments:
                before = found.get(segment.boot)
                first = before.first if before else segment.first
                found[segment.boot] = SpoolRange(segment.boot, first, segment.last)
            return tuple(found.values())

    def damaged_ranges(self, boot: str) -> list[tuple[int, int]]:
        """First and last of each range of features of `boot` whose records are damaged."""
        with self._lock:
            return self._damaged.ranges(boot)

    def append(self, sequence: int, payload: bytes) -> None:
        """Keep `payload`; when this returns, the death of the process does not lose it.

        Raises `ValueError` where `sequence` does not grow, and `SpoolError` where the disk does
        not take it.
        """
        with self._lock:
            if sequence <= self._last:
                raise ValueError(
                    f"Sequence {sequence} was given after {self._last}. Sequences must grow."
                )
            record = pack(sequence, payload)
            self._keep_in_place()
            segment = self._room_for(sequence)
            try:
                write_all(self._descriptor(), record)
                if self._fsync == "always":
                    os.fsync(self._descriptor())
            except OSError as error:
                self._cut_back(segment)
                raise SpoolError(
                    f"The spool {self.folder} does not take sequence {sequence}: {error}. "
                    "Make room on the disk, or lower spool.max_bytes."
                ) from error
            segment.last, segment.count = sequence, segment.count + 1
            segment.acknowledged_s = None
            segment.size += len(record)
            self._size += len(record)
            self._last = sequence
            self._drop_oldest()

    def read(self, boot: str, first: int = 0, last: int | None = None) -> Iterator[bytes]:
        """Return the stored features of `boot` from `first` to `last`, in order."""
        with self._lock:
            wanted = [
                (segment.path, segment.size, segment.first, segment.last, self._open(segment))
                for segment in self._segments
                if segment.boot == boot
                and segment.last >= first
                and (last is None or segment.first <= last)
            ]
        for path, size, begins, ends, current in wanted:
            try:
                data = path.read_bytes()[:size] if current is None else current
            except TAKEN_AWAY:  # also where it was acknowledged or dropped since
                self._note_damage(path, boot, b"", Damage(0, 0, begins, ends))
                continue
            due, sound = begins, list[int]()
            # Damaged records are passed over, and noted.
            for part in scan(data, begins, ends + 1):
                if isinstance(part, Damage):
                    self._note_damage(path, boot, data, part)
                    due = part.last + 1
                    continue
                due = part.sequence + 1
                sound.append(part.sequence)
                if part.sequence >= first and (last is None or part.sequence <= last):
                    yield part.payload
            if due <= ends:  # the end of the file has gone
                self._note_damage(path, boot, data, Damage(len(data), len(data), due, ends))
            with self._lock:
                self._damaged.read_again(path, sound)

    def acknowledge(self, boot: str, sequence: int) -> int:
        """Delete segments of `boot` that end by `sequence`; return how many features.

        Those that are kept for a while are deleted by an acknowledgement that comes later, of
        whatever boot.
        """
        with self._lock:
            # Of a boot that is withheld nothing is forgotten.
            if boot in self._withheld:
                return 0
            now = time.monotonic()
            for segment in self._segments:
                if segment.boot == boot and segment.last <= sequence:
                    segment.acknowledged_s = segment.acknowledged_s or now
            done = [
                segment
                for segment in self._segments
                if segment.acknowledged_s is not None
                and now - segment.acknowledged_s >= self._keep_s
            ]
            for segment in done:
                self._remove(segment)
            if self._gone.get(boot, sequence + 1) <= sequence:
                del self._gone[boot]
                self._write(DROPPED, self._gone)
            return sum(segment.count for segment in done)

    def withholds(self, boot: str) -> bool:
        """Whether nothing of `boot` is forgotten, whatever is acknowledged."""
        return boot in self._withheld

    def withhold(self, boot: str, sequence: int) -> bool:
        """Keep the features of `boot` in spite of acknowledgements; False if it is so already.

        It lasts across restarts, until `withheld.json` is deleted while no agent runs; a full
        spool drops its oldest segments all the same.
        """
        with self._lock:
            if boot in self._withheld:
                return False
            self._withheld[boot] = sequence
            self._write(WITHHELD, self._withheld)
            return True

    def close(self) -> None:
        """Bring everything to the disk and let go of the folder; a second time does nothing."""
        with self._lock:
            self._finish_segment()
            if self._guard is not None:
                unlock(self._guard)
                self._guard = None

    def _open(self, segment: _Segment) -> bytes | None:
        """Return what is in the segment that is being written, wherever its file is now."""
        if self._file is None or segment is not self._segments[-1] or not hasattr(os, "pread"):
            return None
        return os.pread(self._file, segment.size, 0)

    def _note_damage(self, path: Path, boot: str, data: bytes, damage: Damage) -> None:
        with self._lock:
            if any(segment.path == path for segment in self._segments):
                self._damaged.found(path, boot, data, damage)

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

    def _keep_in_place(self) -> None:
        """Write the current segment again where its file was moved, deleted or replaced."""
        if self._file is None or same_file(self._file, self._segments[-1].path):
            return
        segment = self._segments[-1]
        logger.error(
            "%s was moved, deleted or replaced while the agent used it. It is written again, "
            "with all that is not acknowledged. Leave the folder of a spool alone while its "
            "agent runs.", segment.path,
        )  # fmt: skip
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            file = written_again(self._file, segment.path, segment.size)
        except OSError as error:
            raise SpoolError(
                f"The spool cannot write {segment.path} again: {error}. Make room on the disk, "
                "or point spool.folder elsewhere."
            ) from error
        os.close(self._file)
        self._file = file
        if self._guard is not None and not same_file(self._guard, self.folder / LOCK):
            unlock(self._guard)
            self._guard = None  # where another agent has the new one
            self._guard = lock_folder(self.folder)

    def _begin(self, path: Path) -> int:
        """Make a segment file; where the disk does not even take its mark, none is left."""
        self.folder.mkdir(parents=True, exist_ok=True)  # it may have been taken away
        file = os.open(path, NEW, 0o644)
        try:
            write_all(file, MARK)
            if self._fsync == "always":
                sync_folder(self.folder)
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
                    sync_folder(self.folder)
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
            if oldest.acknowledged_s is not None:
                self._remove(oldest)
                continue
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
                self._write(DROPPED, self._gone)

    def _write(self, name: str, boots: dict[str, int]) -> None:
        """Remember some boots across a restart; a full disk may prevent it."""
        path = self.folder / name
        try:
            path.with_suffix(".new").write_text(json.dumps(boots))
            path.with_suffix(".new").replace(path)
        except OSError:
            logger.exception(
                "%s cannot be written; it is kept in memory until the agent ends.", path
            )

    def _remove(self, segment: _Segment) -> None:
        if self._file is not None and segment is self._segments[-1]:
            self._finish_segment(keep=False)
        self._segments.remove(segment)
        self._damaged.forget(segment.path)
        self._size -= segment.size
        segment.path.unlink(missing_ok=True)


def _place(path: Path) -> int:
    """Place of a segment's boot among all; 0 of software that did not name it."""
    place = path.name.partition(".")[0]
    return int(place) if len(place) == 8 and place.isascii() and place.isdigit() else 0


def _boot_of(path: Path) -> str:
    boot = path.name.removesuffix(SUFFIX).rpartition(".")[0]
    return boot.partition(".")[2] if _place(path) else boot


def _first_of(path: Path) -> int:
    """Return the first sequence of a segment, by its name; 0 if the name lacks it."""
    first = path.name.removesuffix(SUFFIX).rpartition(".")[2]
    if not (first.isascii() and first.isdigit()):
        return 0
    return min(int(first), LARGEST_SEQUENCE)


def _open(path: Path, next_path: Path | None, damaged: DamagedBytes) -> _Segment | None:
    """Scan a segment of an earlier run, and set damaged bytes aside."""
    boot, first = _boot_of(path), _first_of(path)
    following = None
    if next_path is not None and _boot_of(next_path) == boot:
        following = _first_of(next_path)
    data = path.read_bytes()
    segment = _Segment(path, boot, first, first - 1, 0, len(data))
    for part in scan(data, first, following):
        if isinstance(part, Sound):
            segment.last, segment.count = part.sequence, segment.count + 1
        else:
            segment.last = max(segment.last, part.last)
            damaged.found(segment.path, boot, data, part)
    if segment.last < first and len(data) <= len(MARK):
        path.unlink()  # its first record was never written
        return None
    return segment


def _read_dropped(path: Path) -> dict[str, int]:
    try:
        return {str(boot): int(last) for boot, last in json.loads(path.read_text()).items()}
    except FileNotFoundError:
        return {}
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        logger.warning("%s cannot be read and is started again: %r", path, error)
        return {}

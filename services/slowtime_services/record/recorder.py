"""The recorder of a bus, in a thread of its own."""

import collections
import concurrent.futures
import dataclasses
import functools
import logging
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Literal, NamedTuple, Self

from slowtime_schemas.streams import (
    FEATURES,
    LONGEST_KEY,
    REGISTRATION,
    STREAMS,
    Stream,
    any_key,
    parse_key,
    request_key,
)
from slowtime_services.bus import Bus, Inbox, Sample, TwoVersionBus, UnpackingBus
from slowtime_services.clock import Clock, SystemClock

from .recovery import repack
from .retransmission import Retransmission
from .series import RecordingSeries
from .writer import CHUNK_BYTES, RecordingWriter, free_path

logger = logging.getLogger(__name__)

RECORDED = tuple(stream for stream in STREAMS if stream.recorded)
LEAST_BYTES = 16 * CHUNK_BYTES
"""Least that a bounded recording may take on the disk."""
SPARE_BYTES = 2 * CHUNK_BYTES
"""Kept free below the bound: a chunk that is being gathered, and the index that ends a file."""
FILES_PER_RECORDING = 8
"""Files that a bounded recording consists of [1], so that at most an eighth is deleted at
once."""


class _Arrival(NamedTuple):
    log_ns: int
    sample: Sample


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """State of a recording."""

    paths: tuple[Path, ...]
    """The files, the newest last."""
    counts: dict[str, int]
    """Messages written, by stream."""
    bytes_written: int
    dropped: int
    """Messages that arrived faster than they could be written."""
    refused: int
    """Messages too large for their stream."""
    missing: int
    """Features that are known to exist and have not come, though asked for."""
    deleted: int = 0
    """Files that were deleted to stay within the bound."""
    unwritten: int = 0
    """Messages that came after the bound was reached, where that ends the recording."""


class Recorder:
    """Writes messages of a bus to MCAP.

    A recorder that is killed loses at most what arrived within `flush_s`; `recover` makes its
    file sound again. Payloads are written as they came, valid or not: a recording is evidence.

    Parameters
    ----------
    bus
        Where to listen; it is left open.
    path
        The file; it must not exist. With `keep_bytes`, where files of its name exist, the next.
    streams
        Which streams; by default those the registry marks as recorded. Features that did not
        arrive are asked for again (see `healing`).
    site, asset
        Whose; by default everybody's.
    clock
        Stamps arrivals, as `log_time`.
    flush_s
        How often what has arrived is put on the disk [s].
    rotate_bytes, rotate_s
        Begin another file, with a number after its name, once this one is so large or old.
    keep_bytes
        Most that the files of this recording, and those of earlier ones under its name (see
        `RecordingSeries`), take on the disk; None for no bound. Exceeded for half a second at
        most, by what arrives in it.
    when_full
        What happens then: the oldest files are deleted, which is logged and said in the
        metadata of the next file; or the recording ends.
    queue_bytes
        How much may wait to be written.

    Raises
    ------
    ValueError
        Where `keep_bytes` is less than `LEAST_BYTES`, or than two files of `rotate_bytes`; or
        where it is reached before anything was written, and nothing may be deleted.

    Examples
    --------
    >>> with Recorder(bus, Path("house.mcap")) as recorder:  # doctest: +SKIP
    ...     recorder.run(stop)
    """

    def __init__(
        self,
        bus: Bus,
        path: Path | str,
        *,
        streams: Iterable[Stream] = RECORDED,
        site: str = "*",
        asset: str = "*",
        clock: Clock | None = None,
        flush_s: float = 0.5,
        rotate_bytes: int | None = None,
        rotate_s: float | None = None,
        keep_bytes: int | None = None,
        when_full: Literal["drop_oldest", "stop"] = "drop_oldest",
        queue_bytes: int = 256 * 2**20,
    ) -> None:
        if keep_bytes is not None:
            if keep_bytes < max(LEAST_BYTES, 2 * (rotate_bytes or 0)):
                raise ValueError(
                    f"A recording of at most {keep_bytes} bytes was asked for. Give at least "
                    f"{LEAST_BYTES}, and twice the size at which another file begins."
                )
            rotate_bytes = rotate_bytes or keep_bytes // FILES_PER_RECORDING
        self._series, self._keep_bytes = RecordingSeries(Path(path)), keep_bytes
        self._when_full, self._full = when_full, threading.Event()
        self._deleted, self._deleted_names = 0, list[str]()
        self._unwritten = 0
        self._streams = frozenset(stream.name for stream in streams)
        self._clock = clock or SystemClock()
        self._flush_s, self._rotate_bytes, self._rotate_s = flush_s, rotate_bytes, rotate_s
        self._inbox: Inbox[_Arrival] = Inbox(max_bytes=queue_bytes)
        self._counts: collections.Counter[str] = collections.Counter()
        self._refused = 0
        self._bytes_on_disk = 0
        self._failure: Exception | None = None
        self._paths = [Path(path) if keep_bytes is None else self._series.next()]
        if when_full == "stop" and self._reached():
            raise ValueError(
                f"The files of {path} take {self._series.size()} bytes already, of the "
                f"{keep_bytes} that they may. Move some away, or allow more."
            )
        self._writer = RecordingWriter(self._paths[0])
        self._repacking = concurrent.futures.ThreadPoolExecutor(1, "recorder-repack")
        self._began = self._flushed = time.monotonic()
        bus = TwoVersionBus(UnpackingBus(bus))
        self._healer = Retransmission(bus, self._arrive)
        self._healing, self._closing = FEATURES.name in self._streams, threading.Event()
        self._threads = [
            threading.Thread(target=work, name=f"recorder-{work.__name__}", daemon=True)
            for work in (self._work, self._heal)
        ]
        for thread in self._threads:
            thread.start()
        self._subscription = bus.subscribe(any_key(site, asset), self._arrive)
        if REGISTRATION.name in self._streams:
            # What twins were told before the recording began; without it none is whole.
            asked = bus.ask(request_key(site, asset, "registration"), timeout_s=1.0)
            for sample in asked:
                self._arrive(sample)

    @property
    def recording(self) -> Recording:
        """Current state of the recording."""
        return Recording(
            paths=tuple(self._paths),
            counts=dict(self._counts),
            bytes_written=self._bytes_on_disk,
            dropped=self._inbox.dropped,
            refused=self._refused,
            missing=self._healer.missing,
            deleted=self._deleted,
            unwritten=self._unwritten,
        )

    @property
    def full(self) -> bool:
        """Whether the recording has ended because its bound was reached."""
        return self._full.is_set()

    def run(
        self,
        stop: threading.Event,
        report: Callable[[Recording], None] | None = None,
        *,
        every_s: float = 0.5,
    ) -> None:
        """Record until `stop` is set, or the bound is reached; pass the state to `report`.

        Raises
        ------
        OSError
            Where the disk takes no more, or whatever else ended the recording.
        """
        while not stop.wait(every_s) and self._failure is None and not self.full:
            if report is not None:
                report(self.recording)
        if self._failure is not None:
            raise self._failure

    def close(self) -> Recording:
        """Stop listening, write messages that have arrived, and finish the file."""
        self._subscription.close()
        self._closing.set()
        for thread in reversed(self._threads):
            thread.join()
        self._repacking.shutdown()
        self._bytes_on_disk = self._size()
        if self._failure is not None:
            raise self._failure
        recording = self.recording
        if recording.dropped or recording.refused or recording.missing:
            logger.warning(
                "The recording lacks %d messages that arrived too fast, %d that were too large "
                "and %d features that never arrived.",
                recording.dropped,
                recording.refused,
                recording.missing,
            )
        return recording

    def __enter__(self) -> Self:
        """Return the recorder, which is recording already."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()

    def _arrive(self, sample: Sample) -> None:
        self._inbox.put(_Arrival(self._clock.now_ns(), sample), len(sample.payload))

    def _work(self) -> None:
        try:
            while not (self._inbox.closed and not self._inbox):
                for arrival in self._inbox.take(1000, timeout_s=self._flush_s / 2):
                    self._write(arrival)
                self._keep()
            self._end_file()
        except Exception as error:
            self._failure = error
            self._inbox.close()
            self._writer.abandon()
            logger.exception("Recording has stopped: %s", error)

    def _heal(self) -> None:
        """Request missing features at intervals, and once before the end."""
        while self._healing and not self._closing.wait(0.5):
            self._heal_once()
        if self._healing:
            self._settle()
            self._heal_once(at_last=True)
        self._closing.wait()
        self._inbox.close()

    def _heal_once(self, *, at_last: bool = False) -> None:
        try:
            self._healer.heal(at_last=at_last)
        except Exception:
            logger.exception("Requesting missing features failed.")

    def _settle(self) -> None:
        """Wait until messages that have arrived are written, so that they are not requested."""
        while self._inbox and self._failure is None:
            time.sleep(0.005)

    def _write(self, arrival: _Arrival) -> None:
        sample = arrival.sample
        address = _address(sample.key) if len(sample.key) <= LONGEST_KEY else None
        if address is None or address[0].name not in self._streams:
            return
        stream, site, asset = address
        if len(sample.payload) > stream.max_bytes:
            self._refused += 1
            return
        if self.full:
            self._unwritten += 1
            return
        if self._healing:
            self._healer.note(sample.key, sample.payload)
        self._counts[stream.name] += 1
        if not self._writer.has_room_for(stream, site, asset):
            self._end_file()
            self._begin_another()
        self._writer.write(stream, site, asset, sample.payload, arrival.log_ns, sample.sent_ns)

    def _keep(self) -> None:
        """Write arrived messages to disk, or begin another file, if it is time."""
        now = time.monotonic()
        if now - self._flushed < self._flush_s / 2:
            return
        if self.full:
            return
        self._writer.flush(sync=True)
        self._flushed = now
        if not self._writer.in_place(self._paths[-1]):
            self._go_on_elsewhere()
        self._bytes_on_disk = self._size()
        if not self._stay_within_bound():
            return
        too_large = self._rotate_bytes and self._writer.bytes_written >= self._rotate_bytes
        too_old = self._rotate_s and now - self._began >= self._rotate_s
        if too_large or too_old:
            self._end_file()
            self._begin_another()
            self._began = now

    def _end_file(self) -> None:
        """Close the file, and join its chunks beside what goes on."""
        if self._writer.close() and self._writer.is_worth_repacking:
            self._repacking.submit(_repack, self._paths[-1])

    def _go_on_elsewhere(self) -> None:
        """Begin another file, because the last one was moved, deleted or replaced."""
        lost = self._paths[-1]
        self._writer.close()  # wherever it is now, it is whole
        lost.parent.mkdir(parents=True, exist_ok=True)
        self._begin_another()
        if self._paths[-1] == lost:
            del self._paths[-2]
        logger.error(
            "%s was moved, deleted or replaced while it was written: it ends here, wherever it "
            "is, and the recording goes on in %s. If it was deleted, what was in it is lost, "
            "except for features that the twin server has.", lost, self._paths[-1],
        )  # fmt: skip

    def _begin_another(self) -> None:
        bounded = self._keep_bytes is not None
        path = self._series.next() if bounded else free_path(self._paths[0])
        said = {"deleted": ", ".join(self._deleted_names)} if self._deleted_names else None
        self._deleted_names.clear()
        self._paths.append(path)
        self._writer = RecordingWriter(path, metadata=said)

    def _reached(self) -> bool:
        """Whether the bound is so near that a chunk more might pass it."""
        most = self._keep_bytes
        return most is not None and self._series.size() > most - SPARE_BYTES

    def _stay_within_bound(self) -> bool:
        """Delete the oldest files, or end the recording; return whether it continues."""
        if not self._reached():
            return True
        assert self._keep_bytes is not None
        if self._when_full == "stop":
            self._end_file()
            self._full.set()
            logger.error(
                "Recording has ended: the files of %s have reached the %d bytes that they may "
                "take.",
                self._paths[0],
                self._keep_bytes,
            )
            return False
        deleted = self._series.shrink_to(self._keep_bytes - SPARE_BYTES, self._paths[-1])
        for path, size in deleted:
            self._deleted += 1
            self._deleted_names.append(path.name)
            logger.warning(
                "%s (%d bytes), the oldest of the recording, was deleted so that its files "
                "take no more than %d bytes.",
                path,
                size,
                self._keep_bytes,
            )
        gone = {path for path, _ in deleted}
        self._paths = [path for path in self._paths if path not in gone]
        return True

    def _size(self) -> int:
        """Bytes of the files of this run that are still there."""
        return sum(path.stat().st_size for path in self._paths if path.exists())


def _repack(path: Path) -> None:
    try:
        repack(path)
    except OSError as error:
        logger.warning("%s keeps its small chunks, which are sound: %s", path, error)


@functools.lru_cache(maxsize=65536)
def _address(key: str) -> tuple[Stream, str, str] | None:
    try:
        return parse_key(key)
    except ValueError:
        return None

"""Notes each batch before it is worked, so that what ended the server is known afterwards.

The note holds a digest of each message. Whoever opens the database next finds the messages of a
batch that was never finished. They are suspected, and worked one by one once their edges send
them again, each noted by itself; the one that ends the server once more is not tried again. A
message that was alone when the server stood still is not even tried a second time.
"""

import contextlib
import enum
import hashlib
import logging
import struct
import threading
from collections.abc import Iterable, Iterator

from twin_server.persist import MARKED, AttemptNote, StoreError

from .phases import Phase, Progress

logger = logging.getLogger(__name__)

MOST_SUSPECTED = 20_000
"""Messages that are suspected at most; ten batches of the usual size, 400 kB."""

_HEADER = struct.Struct("<c3sI")
_ENTRY = struct.Struct("<16sBB")
_MAGIC = b"SL1"
_UNMARKED = b"-"


class Suspicion(enum.IntEnum):
    """How a message is worked."""

    NONE = 0
    """With others."""
    ALONE = 1
    """Alone, because a batch with it was not finished."""
    UNTRIED = 2
    """Not at all but for its place in the history, because it ended the server."""
    REFUSED = 3
    """Not even that."""


def digest_of(payload: bytes) -> bytes:
    """Return the digest by which a message is recognised when it is sent again."""
    return hashlib.blake2b(payload, digest_size=16).digest()


class Attempts:
    """The note of a store, and the suspicions that follow from the last one.

    Parameters
    ----------
    note
        Of the store.
    progress
        Told that the note is being written.
    """

    def __init__(self, note: AttemptNote, progress: Progress | None = None) -> None:
        self._note, self._lock = note, threading.Lock()
        self._progress, self._told = progress or Progress(), False
        self._suspected: dict[bytes, int] = {}
        self._current: dict[bytes, None] = {}
        self._load()

    @property
    def some(self) -> bool:
        """Whether any message is suspected."""
        return bool(self._suspected)

    def suspicion(self, payload: bytes) -> Suspicion:
        """Return how a message is worked."""
        if not self._suspected:
            return Suspicion.NONE
        return Suspicion(self._suspected.get(digest_of(payload), 0))

    @contextlib.contextmanager
    def noted(self, payloads: Iterable[bytes]) -> Iterator[None]:
        """Note messages while they are worked; within, a part of them or others.

        They are no longer suspected once they were worked, unless they are never to be tried.
        """
        before, digests = self._current, tuple(map(digest_of, payloads))
        self._note_current(digests)
        try:
            yield
        finally:
            for digest in digests:
                if self._suspected.get(digest, 0) < Suspicion.UNTRIED:
                    self._suspected.pop(digest, None)
            self._note_current(before)

    @contextlib.contextmanager
    def noted_too(self, payloads: Iterable[bytes]) -> Iterator[None]:
        """Note further messages beside those that are being worked."""
        more = [p for p in payloads if digest_of(p) not in self._current]
        if not more:
            yield
            return
        before = self._current
        self._note_current((*before, *map(digest_of, more)))
        try:
            yield
        finally:
            self._note_current(before)

    def mark(self) -> None:
        """Mark the note: the server stands still in what it notes."""
        with self._lock:
            found = self._note.read()
            if found:
                self._note.write(MARKED + found[1:])

    def forget(self, payload: bytes) -> None:
        """Suspect a message no longer."""
        if self._suspected.pop(digest_of(payload), None) is not None:
            self._note_current(self._current)

    def _note_current(self, current: Iterable[bytes]) -> None:
        self._current = dict.fromkeys(current)
        self._write(self._current)

    def _write(self, current: Iterable[bytes]) -> None:
        entries = [_ENTRY.pack(digest, self._suspected.get(digest, 0), 1) for digest in current]
        entries += [
            _ENTRY.pack(digest, level, 0)
            for digest, level in self._suspected.items()
            if digest not in self._current
        ]
        note = _HEADER.pack(_UNMARKED, _MAGIC, len(entries)) + b"".join(entries)
        try:
            with self._lock, self._progress.doing(Phase.STORE):
                self._note.write(note)
            self._told = False
        except StoreError as error:
            # The batch goes on: what it leads to is stored as well, or fails there.
            if not self._told:
                logger.warning("What is being worked cannot be noted: %s", error)
            self._told = True

    def _load(self) -> None:
        """Read the last note; what was being worked then becomes more suspect."""
        found = self._note.read()
        if len(found) < _HEADER.size:
            return
        mark, magic, count = _HEADER.unpack_from(found)
        body = found[_HEADER.size : _HEADER.size + count * _ENTRY.size]
        if magic != _MAGIC or len(body) < count * _ENTRY.size:
            return  # of a computer that lost power, or of another version
        entries = [*_ENTRY.iter_unpack(body)]
        unfinished = sum(current for _, _, current in entries)
        for digest, level, current in entries[:MOST_SUSPECTED]:
            level = min(level + current, Suspicion.REFUSED)
            if current and unfinished == 1 and mark == MARKED:
                level = max(level, Suspicion.UNTRIED)
            self._suspected[digest] = level
        if unfinished:
            logger.warning(
                "The last server ended while it worked on %d messages%s. They are worked one "
                "by one when they come again; one that ends the server again is set aside.",
                unfinished,
                ", standing still" if mark == MARKED else "",
            )

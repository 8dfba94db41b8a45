"""Compares the files of an open SQLite database with what is at their paths.

A file that is moved, deleted or replaced stays open to whoever uses it. Commits then succeed,
and the next start finds none of them. So nothing is acknowledged while a path leads elsewhere.
"""

import contextlib
import enum
import logging
import os
import sqlite3
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from slowtime_services.operating_system import lock_file

from .errors import StoreInUseError, WrongStoreError

logger = logging.getLogger(__name__)

HEADER_BYTES = 100
"""Header of a database file [bytes]: SQLite's file format, section 1.3. It holds the size in
pages and a counter of changes, and is written by a checkpoint alone while the log is in use."""

SIDE_FILES = ("-wal", "-shm")
"""Ends of the names of the write-ahead log and of its index."""


class GroundKind(enum.Enum):
    """What has become of the files."""

    AWAY = "away"
    """The path leads nowhere, and the file lives under another name."""
    DELETED = "deleted"
    """The file has no name any more, and ends with the process."""
    REPLACED = "replaced"
    """The path leads to another file."""
    OVERWRITTEN = "overwritten"
    """Another program has written into the file."""


class Fault(NamedTuple):
    """What is wrong, for a person."""

    kind: GroundKind
    text: str


class Ground:
    """The files of a database that this process has open.

    Parameters
    ----------
    path
        Of the database, whose write-ahead log is open already.

    Notes
    -----
    The file is open here once more, for the number of its names and for its header. It has to
    be closed after all connections of the process: closing it ends their locks (POSIX `fcntl`).
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
        self._identities = {
            name: _identity(name) for name in (path, *map(self._beside, SIDE_FILES))
        }
        self._overwritten = self._changing = False
        # Held for a moment only: readers look at the files while the writer changes them.
        self._lock = threading.Lock()
        self._looks, self._log_bytes = self._look(), self.log_bytes

    @contextlib.contextmanager
    def changing(self) -> Iterator[None]:
        """Hold while this process itself changes the files, by a commit or a checkpoint.

        A commit may begin the log anew, which shortens it, and a checkpoint writes the header.
        What the files look like is not judged meanwhile, and noted at the end.
        """
        with self._lock:
            self._changing = True
        try:
            yield
        finally:
            with self._lock:
                self._looks, self._log_bytes = self._look(), self.log_bytes
                self._changing = False

    @property
    def log_bytes(self) -> int:
        """Size of the write-ahead log [bytes]; 0 where it is not there."""
        with contextlib.suppress(OSError):
            return os.stat(self._beside("-wal")).st_size
        return 0

    def fault(self) -> Fault | None:
        """Return what is wrong with the files; None if nothing is."""
        with self._lock:
            if not self._changing and (self._look() != self._looks or self._has_shrunk()):
                self._overwritten = True
        if self._overwritten:
            return Fault(GroundKind.OVERWRITTEN, self._text_of_overwritten())
        for path, identity in self._identities.items():
            found = _identity(path)
            if found == identity:
                continue
            if path != self._path:
                return Fault(GroundKind.REPLACED, self._text_of_side_file(path))
            if self._names() == 0:
                return Fault(GroundKind.DELETED, self._text_of_deleted())
            if found is None:
                return Fault(GroundKind.AWAY, self._text_of_away())
            return Fault(GroundKind.REPLACED, self._text_of_replaced())
        return None

    def close(self) -> None:
        """Let go of the file, after all connections to it are closed."""
        os.close(self._file)

    def _has_shrunk(self) -> bool:
        """Whether the log lost bytes, which only the last one to leave takes."""
        before, self._log_bytes = self._log_bytes, self.log_bytes
        return self._log_bytes < before and self._beside("-wal").exists()

    def _beside(self, end: str) -> Path:
        return self._path.with_name(self._path.name + end)

    def _look(self) -> tuple[int, bytes]:
        if hasattr(os, "pread"):
            header = os.pread(self._file, HEADER_BYTES, 0)
        else:  # pragma: no cover  (Windows, where nobody else uses this descriptor's place)
            os.lseek(self._file, 0, os.SEEK_SET)
            header = os.read(self._file, HEADER_BYTES)
        return os.fstat(self._file).st_size, header

    def _names(self) -> int:
        return os.fstat(self._file).st_nlink

    def _text_of_away(self) -> str:
        return (
            f"{self._path} was moved away while the server used it. Nothing is acknowledged; "
            "edge agents keep what they send. Move it back, with the files beside it whose "
            "names begin like it, and the server goes on."
        )

    def _text_of_deleted(self) -> str:
        return (
            f"{self._path} was deleted while the server used it. Nothing is acknowledged; edge "
            "agents keep what they send. The server writes a copy of all that was acknowledged "
            "beside it, and says so in its log. End the server then, rename the copy, and "
            "start the server."
        )

    def _text_of_replaced(self) -> str:
        return (
            f"Another file was put at {self._path} while the server used the one before. "
            "Nothing is acknowledged; edge agents keep what they send. Move the one before "
            "back, and the server goes on. Or end the server and start it again, on the new "
            "file: what that lacks is requested from the edge agents."
        )

    def _text_of_side_file(self, path: Path) -> str:
        return (
            f"{path} was removed or replaced while the server used it. Nothing is "
            "acknowledged; edge agents keep what they send. What was acknowledged is in "
            f"{self._path}. End the server and start it again."
        )

    def _text_of_overwritten(self) -> str:
        return (
            f"Another program has written into {self._path}, or cut its log, while the server "
            "used it: a copy over it, or an SQL shell. Nothing is acknowledged, or answered "
            "from it. End the server, restore the last backup with `slowtime db restore` if "
            "you did not, and start the server: it verifies all rows, and requests what is "
            "missing from the edge agents."
        )


def _identity(path: Path) -> tuple[int, int] | None:
    """Device and number of the file at a path; None where there is none."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_dev, found.st_ino


@contextlib.contextmanager
def guarding(path: Path) -> Iterator[None]:
    """Keep servers off a file for a while; refused where one uses it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    guard = take_lock(path)
    try:
        yield
    finally:
        if guard is not None:
            os.close(guard)


def lock_of(path: Path) -> Path:
    """Return the file whose lock keeps a second server off a database."""
    return path.with_name(path.name + ".lock")


def take_lock(path: Path) -> int | None:
    """Keep a second server off the file; the lock dies with the process."""
    lock = lock_of(path)
    try:
        file = os.open(lock, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise WrongStoreError(
            f"{lock} cannot be written: {error.strerror}. Make room on the disk and let this "
            "user write there, or give another --database."
        ) from error
    try:
        lock_file(file, wait=False)
    except OSError as error:
        os.close(file)
        raise StoreInUseError(
            f"{path} is in use by another twin server. End that one, or give this one another "
            "--database."
        ) from error
    return file


def rescue(writer: sqlite3.Connection, path: Path) -> None:
    """Copy a database whose file was deleted beside its path, and log where.

    The folder is made again if it was deleted as well.
    """
    number = 1
    while (out := path.with_name(f"{path.name}.rescued-{number}")).exists():
        number += 1
    try:
        _copy(writer, out)
    except (OSError, sqlite3.Error) as error:
        logger.error(
            "%s was deleted, and its copy %s cannot be written: %s. What was acknowledged ends "
            "with this process, except for what edge agents still hold.", path, out, error,
        )  # fmt: skip
        return
    logger.error(
        "All that was acknowledged is in %s. End the server, rename that to %s, and start the "
        "server.", out, path,
    )  # fmt: skip


def _copy(writer: sqlite3.Connection, out: Path) -> None:
    """Copy a database; a copy that is not whole does not have the name `out`."""
    out.parent.mkdir(parents=True, exist_ok=True)
    part = out.with_name(f".{out.name}.part")
    part.unlink(missing_ok=True)
    with contextlib.closing(sqlite3.connect(part, isolation_level=None)) as copy:
        writer.backup(copy)
        copy.execute("pragma journal_mode=delete")
    file = os.open(part, os.O_RDWR)
    try:
        os.fsync(file)
    finally:
        os.close(file)
    part.rename(out)

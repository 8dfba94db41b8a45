"""Where a server notes what it is about to do, before it does it: a file, or a row.

The note has to survive the end of the process, not of the computer: a file is written without
waiting for the disk, and a row is committed without waiting for it (`synchronous_commit`).
"""

import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from .errors import StoreError

MARKED = b"h"
"""First byte of a note that was marked (`slowtime_services.supervision.watcher.MARK`)."""


class AttemptNote(Protocol):
    """One note, replaced as a whole."""

    path: Path | None
    """File of the note, for a watcher that marks it; None where it is no file."""

    def read(self) -> bytes:
        """Return the note; empty where there is none."""
        ...

    def write(self, note: bytes) -> None:
        """Replace the note."""
        ...


def note_of(database: Path) -> Path:
    """Return the path of the note of a database file."""
    return database.with_name(database.name + ".attempt")


class FileNote:
    """A note in a file beside the database.

    Parameters
    ----------
    path
        Of the file, which is made with the first note.
    """

    def __init__(self, path: Path) -> None:
        self.path: Path | None = path
        self._file: int | None = None

    def read(self) -> bytes:
        """Return the note; empty where there is none."""
        assert self.path is not None
        with contextlib.suppress(FileNotFoundError):
            return self.path.read_bytes()
        return b""

    def write(self, note: bytes) -> None:
        """Replace the note."""
        assert self.path is not None
        try:
            if self._file is None:
                self._file = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o644)
            os.lseek(self._file, 0, os.SEEK_SET)
            os.write(self._file, note)
        except OSError as error:
            raise StoreError(
                f"{self.path} cannot be written: {error.strerror}. Make room on the disk, and "
                "let this user write there."
            ) from error

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            os.close(self._file)
            self._file = None


class RowNote:
    """A note in a row of a PostgreSQL database.

    Parameters
    ----------
    writing
        Holds the writer in a transaction.
    """

    def __init__(self, writing: Callable[[], contextlib.AbstractContextManager[Any]]) -> None:
        self.path: Path | None = None
        self._writing = writing

    def read(self) -> bytes:
        """Return the note; empty where there is none."""
        with self._writing() as writer:
            row = writer.execute("select body from attempts").fetchone()
        return b"" if row is None else bytes(row[0])

    def write(self, note: bytes) -> None:
        """Replace the note."""
        with self._writing() as writer:
            writer.execute("set local synchronous_commit to off")
            writer.execute(
                "insert into attempts (what, body) values ('pipeline', ?) "
                "on conflict (what) do update set body = excluded.body",
                (note,),
            )

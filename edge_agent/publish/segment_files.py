"""Files of a spool: written, written again where they were taken away, and locked."""

import os
from pathlib import Path

from slowtime_services.operating_system import lock_file

LOCK = "lock"
NEW = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_APPEND
"""How a segment is opened: for reading as well, so that it can be written again."""


class SpoolError(OSError):
    """The spool cannot be used; the text says what to do."""


def written_again(file: int, path: Path, size: int) -> int:
    """Write the first bytes of an open file to a path; return the new file, open."""
    part = path.with_suffix(".new")
    part.unlink(missing_ok=True)
    other = os.open(part, NEW, 0o644)
    try:
        os.lseek(file, 0, os.SEEK_SET)
        write_all(other, os.read(file, size))
        part.replace(path)
    except OSError:
        os.close(other)
        raise
    return other


def write_all(file: int, data: bytes) -> None:
    """Write all of some bytes to an open file."""
    view = memoryview(data)
    while view:
        view = view[os.write(file, view) :]


def lock_folder(folder: Path) -> int | None:
    """Keep a second agent out of the folder; the lock dies with the process."""
    file = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        lock_file(file, wait=False)
    except OSError as error:
        os.close(file)
        raise SpoolError(
            f"The spool {folder} is in use by another edge agent. Stop that one, or give this "
            "one its own spool.folder."
        ) from error
    return file


def unlock(file: int | None) -> None:
    """Let go of the folder."""
    if file is not None:
        os.close(file)

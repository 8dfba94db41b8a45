"""Backs up a database while it is written, and restores a backup."""

import contextlib
import os
import shutil
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from slowtime_services.operating_system import sync_folder

from .errors import WrongStoreError
from .layout import Tell
from .sqlite import guarding, open_reader, verify_file

_LEFTOVERS = ("-wal", "-shm", "-journal")


def backup(database: Path, out: Path, tell: Tell | None = None) -> None:
    """Copy one moment of a database into the new file `out`, beside a server that writes it.

    The copy is looked through before it gets its name: a file of that name is whole.

    Raises
    ------
    WrongStoreError
        Where `database` is not there or damaged, or `out` exists.
    """
    _must_exist(database)
    if database.stat().st_size == 0:
        raise WrongStoreError(f"{database} is empty. Give the database of a twin server.")
    with _made_whole(out) as part:
        try:
            with (
                contextlib.closing(open_reader(database)) as reader,
                contextlib.closing(sqlite3.connect(part, isolation_level=None)) as copy,
            ):
                reader.execute("begin")
                reader.backup(copy)
                copy.execute("pragma journal_mode=delete")
        except sqlite3.Error as error:
            raise WrongStoreError(
                f"{database} cannot be copied: {error}. Look at it with `slowtime check`, and "
                "at the room on the disk."
            ) from error
        verify_file(part, tell, source=database)


def restore(copy: Path, database: Path, tell: Tell | None = None) -> Path | None:
    """Restore a backup; the database in its place is renamed and kept.

    Returns
    -------
    Where what was there is now; None where nothing was.

    Raises
    ------
    WrongStoreError
        Where `copy` is no sound backup, or a server uses `database`.
    """
    _must_exist(copy)
    verify_file(copy, tell)
    with guarding(database):
        aside = _set_aside(database)
        with _made_whole(database) as part:
            shutil.copyfile(copy, part)
    return aside


def _must_exist(path: Path) -> None:
    if not path.is_file():
        raise WrongStoreError(f"There is no file {path}. Give the path of a database.")


@contextlib.contextmanager
def _made_whole(path: Path) -> Iterator[Path]:
    """Yield a name to write under; `path` is afterwards complete on disk, or absent."""
    if path.exists():
        raise WrongStoreError(f"{path} exists. Give a new file, or take that one away.")
    part = path.with_name(f".{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.unlink(missing_ok=True)
        yield part
        _sync(part)
        part.rename(path)
        _sync(path.parent)
    except OSError as error:
        raise WrongStoreError(f"{path} cannot be written: {error}.") from error
    finally:
        for name in (part, *(part.with_name(part.name + end) for end in _LEFTOVERS)):
            name.unlink(missing_ok=True)


def _set_aside(database: Path) -> Path | None:
    """Rename a database and its side files; none of them is lost."""
    if not database.exists():
        for end in _LEFTOVERS:
            database.with_name(database.name + end).unlink(missing_ok=True)
        return None
    number = 1
    while (aside := database.with_name(f"{database.name}.aside-{number}")).exists():
        number += 1
    for end in ("", *_LEFTOVERS):
        old = database.with_name(database.name + end)
        if old.exists():
            old.rename(aside.with_name(aside.name + end))
    return aside


def _sync(path: Path) -> None:
    if path.is_dir():
        sync_folder(path)
        return
    file = os.open(path, os.O_RDWR)  # Windows brings only files to the disk that may be written
    try:
        os.fsync(file)
    finally:
        os.close(file)

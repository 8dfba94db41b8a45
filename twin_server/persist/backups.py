"""Backs up a database while it is written, and restores a backup."""

import contextlib
import os
import shutil
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from slowtime_services.operating_system import sync_folder

from .errors import WrongStoreError
from .ground import guarding
from .layout import Tell
from .sqlite import open_reader, verify_file

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
    if out.exists():
        raise WrongStoreError(f"{out} exists. Give a new file, or take that one away.")
    with _partial(out) as part:
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
                f"{database} cannot be copied: {error}. Look at it with `slowtime db check`, "
                "and at the room on the disk."
            ) from error
        verify_file(part, tell, source=database)
        _sync(part)
        part.rename(out)
        _sync(out.parent)


def restore(copy: Path, database: Path, tell: Tell | None = None) -> Path | None:
    """Restore a backup; the database in its place is renamed and kept.

    Returns
    -------
    Where what was there is now; None where nothing was.

    Raises
    ------
    WrongStoreError
        Where `copy` is no sound backup, a server uses `database`, or the disk has no room;
        the previous database stays in its place then.
    """
    _must_exist(copy)
    with guarding(database), _partial(database) as part:
        shutil.copyfile(copy, part)
        verify_file(part, tell, source=copy)
        _sync(part)
        return _exchange(part, database)


def _must_exist(path: Path) -> None:
    if not path.is_file():
        raise WrongStoreError(f"There is no file {path}. Give the path of a database.")


@contextlib.contextmanager
def _partial(path: Path) -> Iterator[Path]:
    """Yield a name beside `path` to write under; what is left of it in the end is removed."""
    part = path.with_name(f".{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.unlink(missing_ok=True)
        yield part
    except OSError as error:
        raise WrongStoreError(f"{path} cannot be written: {error}.") from error
    finally:
        for name in _with_side_files(part):
            name.unlink(missing_ok=True)


def _exchange(part: Path, database: Path) -> Path | None:
    """Set a database aside and put a copy in its place; where that fails, move it back."""
    aside = _name_aside(database) if database.exists() else None
    try:
        if aside is None:
            for name in _with_side_files(database):
                name.unlink(missing_ok=True)
        else:
            _move(database, aside)
        part.rename(database)
        _sync(database.parent)
    except OSError as error:
        raise WrongStoreError(
            f"{database} cannot be replaced: {error}. {_move_back(aside, database)}"
        ) from error
    return aside


def _move_back(aside: Path | None, database: Path) -> str:
    """Undo `_exchange`; return a sentence that says where the previous database is."""
    if aside is None:
        return "There was no previous database."
    try:
        _move(aside, database)
    except OSError as error:
        return (
            f"The previous database could not be moved back from {aside}: {error}. Rename it, "
            "and the files beside it whose names begin like it."
        )
    return "The previous database is in its place."


def _name_aside(database: Path) -> Path:
    number = 1
    while (aside := database.with_name(f"{database.name}.aside-{number}")).exists():
        number += 1
    return aside


def _move(database: Path, to: Path) -> None:
    """Rename a database and its side files, as far as they are there."""
    for old, new in zip(_with_side_files(database), _with_side_files(to), strict=True):
        if old.exists():
            old.replace(new)


def _with_side_files(path: Path) -> list[Path]:
    return [path.with_name(path.name + end) for end in ("", *_LEFTOVERS)]


def _sync(path: Path) -> None:
    if path.is_dir():
        sync_folder(path)
        return
    file = os.open(path, os.O_RDWR)  # Windows brings only files to the disk that may be written
    try:
        os.fsync(file)
    finally:
        os.close(file)

"""Opens the store that a path or a URL names."""

from pathlib import Path
from typing import Literal

from .postgres import PostgresStore
from .sqlite import SqliteStore


def is_url(database: str | Path) -> bool:
    """Whether a database is named by a URL and not by a path.

    Examples
    --------
    >>> is_url("postgresql://db/house"), is_url("twin.sqlite")
    (True, False)
    """
    return str(database).startswith(("postgresql://", "postgres://"))


def open_store(
    database: str | Path, *, synchronous: Literal["NORMAL", "FULL"] = "FULL"
) -> SqliteStore | PostgresStore:
    """Open the store that a path or a URL names.

    Raises
    ------
    WrongStoreError
        Where it cannot be used; the text says what to do.
    """
    if is_url(database):
        return PostgresStore(str(database))
    return SqliteStore(Path(database), synchronous=synchronous)

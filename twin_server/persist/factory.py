"""Opens the store that a path or a URL names."""

from pathlib import Path
from typing import Literal

from slowtime_services.shards import Share

from .attempts import note_of
from .postgres import PostgresStore
from .shares import check_unshared, database_of_share, postgres_share
from .sqlite import SqliteStore


def is_url(database: str | Path) -> bool:
    """Whether a database is named by a URL and not by a path.

    Examples
    --------
    >>> is_url("postgresql://db/house"), is_url("twin.sqlite")
    (True, False)
    """
    return str(database).startswith(("postgresql://", "postgres://"))


def note_path(database: str | Path, share: Share | None = None) -> Path | None:
    """Return the file of the note of a store (`attempts`); None where it is a row."""
    if is_url(database):
        return None
    path = Path(database) if share is None else database_of_share(Path(database), share)
    return note_of(path)


def open_store(
    database: str | Path,
    *,
    synchronous: Literal["NORMAL", "FULL"] = "FULL",
    share: Share | None = None,
) -> SqliteStore | PostgresStore:
    """Open the store that a path or a URL names.

    Parameters
    ----------
    share
        Open the store of these assets, which lies beside: a file or schema of its own.

    Raises
    ------
    WrongStoreError
        Where it cannot be used; the text says what to do.
    """
    if is_url(database):
        url = str(database)
        return PostgresStore(url if share is None else postgres_share(url, share))
    path = Path(database)
    if share is None:
        check_unshared(path)
    else:
        path = database_of_share(path, share)
    return SqliteStore(path, synchronous=synchronous)

"""Databases of shards: a file beside the one named, or a schema of the same PostgreSQL.

A history is bound to the number of shards it was made with. Where shards of another number, or
a single server, have left one, nothing is opened, since its twins would seem to be gone.
"""

import re
from collections.abc import Iterable
from pathlib import Path

from slowtime_services.shards import Share

from .errors import WrongStoreError
from .postgres import driver, without_secret

_SHARE = re.compile(r"shard[-_](\d+)[-_]of[-_](\d+)")


def database_of_share(path: Path, share: Share) -> Path:
    """Return the SQLite file of a shard.

    Raises
    ------
    WrongStoreError
        If there are files of another number of shards, or of a single server.

    Examples
    --------
    >>> database_of_share(Path("twin.sqlite"), Share(0, 4)).name
    'twin.shard-0-of-4.sqlite'
    """
    if path.exists():
        raise _other(str(path), "a single server", share)
    beside = path.parent.glob(f"{path.stem}.shard-*-of-*{path.suffix}")
    _check_count(str(path), (other.name for other in beside), share)
    return path.with_name(f"{path.stem}.shard-{share.index}-of-{share.count}{path.suffix}")


def check_unshared(path: Path) -> None:
    """Refuse a new file for a single server beside the files of shards.

    Raises
    ------
    WrongStoreError
        If shards have left files beside, and there is no file of that name.
    """
    if path.exists():
        return
    for other in path.parent.glob(f"{path.stem}.shard-*-of-*{path.suffix}"):
        if match := _SHARE.search(other.name):
            raise WrongStoreError(
                f"{path} holds the history of {match[2]} shards, and a single server was asked "
                f"for. Start with --shards {match[2]}, or give another --database and replay "
                "into it what was recorded."
            )


def postgres_share(url: str, share: Share) -> str:
    """Make the schema of a shard where there is none; return the URL that names it.

    Raises
    ------
    WrongStoreError
        If the database cannot be reached, or has schemas of another number of shards or tables
        of a single server.
    """
    psycopg = driver()
    try:
        with psycopg.connect(url, autocommit=True, connect_timeout=10) as connection:
            base = connection.execute("select current_schema()").fetchone()[0]
            if connection.execute("select to_regclass('numbers')").fetchone()[0] is not None:
                raise _other(without_secret(url), "a single server", share)
            names = connection.execute(
                "select nspname from pg_namespace where starts_with(nspname, %s)",
                (f"{base}_shard_",),
            ).fetchall()
            _check_count(without_secret(url), (name for (name,) in names), share)
            schema = f"{base}_shard_{share.index}_of_{share.count}"
            connection.execute(f'create schema if not exists "{schema}"')
    except psycopg.Error as error:
        name = without_secret(url)
        said = str(error).replace(url, name).strip()
        raise WrongStoreError(
            f"{name} cannot be reached: {said}. Start the database, or correct --database, "
            "PGPASSFILE and the like."
        ) from error
    return f"{url}{'&' if '?' in url else '?'}options=-csearch_path%3D{schema}"


def _check_count(name: str, names: Iterable[str], share: Share) -> None:
    """Refuse histories that were made with another number of shards."""
    found = {int(match[2]) for each in names if (match := _SHARE.search(each))}
    for count in sorted(found - {share.count}):
        raise _other(name, f"{count} shards", share)


def _other(name: str, whose: str, share: Share) -> WrongStoreError:
    return WrongStoreError(
        f"{name} holds the history of {whose}, and {share.count} shards were asked for. Start "
        "with the same number of shards, or give another --database and replay into it what "
        "was recorded."
    )

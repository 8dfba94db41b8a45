"""Statements that select, insert and count rows of checked tables."""

from collections.abc import Iterable, Sequence
from typing import Any, Protocol

from .checksums import NUMBERS, SqlTable, opened

KEYS_PER_QUERY = 500
"""Keys that one `in (…)` names at most; SQLite before 3.32 allows 999 parameters."""

ALL_ROWS = 1 << 62
"""Limit of a query that wants all rows."""


class Connection(Protocol):
    """A database connection; question marks stand for parameters."""

    def execute(self, question: str, parameters: Sequence[Any] = ..., /) -> Any:
        """Ask, and give a cursor over the answer."""
        ...

    def executemany(self, question: str, parameters: Iterable[Sequence[Any]], /) -> Any:
        """Do the same with each of some parameters."""
        ...


def select(
    reader: Connection,
    table: SqlTable,
    where: str = "",
    parameters: Sequence[Any] = (),
    limit: int = ALL_ROWS,
    newest: bool = False,
) -> list[Any]:
    """Return rows in the order of their key; the checksum of each is verified."""
    rows = reader.execute(
        f"select {', '.join(table.all_columns)} from {table.name} {where} "
        f"order by {table.key} {'desc' if newest else ''} limit ?",
        (*parameters, limit),
    )
    return opened(table, rows)


def insert(
    writer: Connection,
    table: SqlTable,
    rows: Iterable[Sequence[object]],
    *,
    otherwise: str = "",
) -> None:
    """Insert rows with their checksums; `otherwise` is the clause for keys that are there."""
    sealed = [table.sealed(row) for row in rows]
    if sealed:
        names = table.all_columns
        writer.executemany(
            f"insert into {table.name} ({', '.join(names)}) "
            f"values ({','.join('?' * len(names))}) {otherwise}",
            sealed,
        )


def absent(
    reader: Connection, table: SqlTable, keys: Sequence[str], rows: Iterable[Sequence[Any]]
) -> list[Sequence[Any]]:
    """Return the rows whose key is not there yet; of several of one key the first."""
    at = [table.columns.index(name) for name in keys]
    where = " and ".join(f"{name} = ?" for name in keys)
    found: dict[tuple[Any, ...], Sequence[Any]] = {}
    for row in rows:
        key = tuple(row[place] for place in at)
        if key not in found and not (
            reader.execute(f"select 1 from {table.name} where {where}", key).fetchone()
        ):
            found[key] = row
    return list(found.values())


def upsert(writer: Connection, table: SqlTable, rows: Iterable[Sequence[object]]) -> None:
    """Insert rows whose first column is their key, or replace those of the same key."""
    key, *others = table.all_columns
    changed = ", ".join(f"{name} = excluded.{name}" for name in others)
    insert(writer, table, rows, otherwise=f"on conflict ({key}) do update set {changed}")


def rows_by_key(writer: Connection, table: SqlTable, keys: Sequence[object]) -> dict[Any, Any]:
    """Rows of the given keys, by them."""
    found: dict[Any, Any] = {}
    for first in range(0, len(keys), KEYS_PER_QUERY):
        asked = keys[first : first + KEYS_PER_QUERY]
        where = f"where {table.columns[0]} in ({','.join('?' * len(asked))})"
        found |= {row[0]: row for row in select(writer, table, where, asked)}
    return found


def last_number(reader: Connection, what: str) -> int | None:
    """Read the last number that was given to runs, events or other rows that are counted."""
    rows = select(reader, NUMBERS, "where what = ?", (what,))
    return int(rows[0][1]) if rows else None


def note_number(writer: Connection, what: str, value: int) -> None:
    """Keep the last number that was given."""
    upsert(writer, NUMBERS, [(what, value)])

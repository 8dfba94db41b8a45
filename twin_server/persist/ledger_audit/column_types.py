"""Finds values of another type than their column has, which SQLite lets a forger put in.

A text in the place of a blob or a number would be read and shown otherwise than what was
accepted, or make the audit fail. PostgreSQL has no such values.
"""

import contextlib
import functools
import sqlite3
from collections.abc import Iterator
from typing import Any

from twin_server.persist.layout import schema
from twin_server.persist.tables.checksums import TABLES


def wrong_types(reader: Any) -> list[str]:
    """Return a sentence on each column that holds values of another type."""
    if not isinstance(reader, sqlite3.Connection):
        return []
    return list(_wrong_columns(reader))


def _wrong_columns(reader: sqlite3.Connection) -> Iterator[str]:
    for table in TABLES:
        types = _types(table.name)
        is_wrong = [
            f"typeof({column}) not in ({', '.join(map(repr, types[column]))})"
            for column in table.columns
        ]
        # One pass for all columns, since hardly ever anything is found.
        question = f"select 1 from {table.name} where"
        if reader.execute(f"{question} {' or '.join(is_wrong)} limit 1").fetchone() is None:
            continue
        for column, condition in zip(table.columns, is_wrong, strict=True):
            if reader.execute(f"{question} {condition} limit 1").fetchone() is not None:
                yield f"the column {column} of {table.name} holds a value of another type"


@functools.cache
def _types(table: str) -> dict[str, tuple[str, ...]]:
    """Types of the values of each column, by the layout; not by the file, which may lie."""
    with contextlib.closing(sqlite3.connect(":memory:")) as fresh:
        fresh.executescript(schema())
        rows = fresh.execute(f"pragma table_info({table})").fetchall()
    return {
        name: (kind.lower(),) if is_never_null or is_key else (kind.lower(), "null")
        for _, name, kind, is_never_null, _, is_key in rows
    }

"""The table of the details of twins of elements; empty for all other twins."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from twin_server.persist.tables.rows import DetailRow

from .checksums import DETAILS, damaged, seal
from .search import SHIFT, whole

_ASKED = 500
"""Keys that one query names at most; SQLite before 3.32 allows 999 parameters."""


def insert_details(writer: Any, rows: Iterable[DetailRow]) -> None:
    """Keep some more."""
    writer.executemany(
        "insert into details (id, changes, body, changes_crc, body_crc) values (?,?,?,?,?)",
        [DETAILS.sealed((n << SHIFT | s, changes, body)) for n, s, changes, body in rows],
    )


def delete_details(writer: Any, twin_id: str) -> None:
    """Drop all of a twin."""
    for span in whole(writer, twin_id):
        writer.execute("delete from details where id between ? and ?", (span.first, span.last))


def has_details(reader: Any, keys: Sequence[int]) -> bool:
    """Whether any of these states may have some; cheap where there are none."""
    if not keys:
        return False
    question = "select 1 from details where id between ? and ? limit 1"
    return reader.execute(question, (min(keys), max(keys))).fetchone() is not None


def column(reader: Any, keys: Sequence[int], name: str) -> list[bytes | None]:
    """Read one column of the details of `keys`; None where one has none, empty where all."""
    found: dict[int, bytes] = {}
    for first in range(0, len(keys), _ASKED):
        asked = keys[first : first + _ASKED]
        marks = ",".join("?" * len(asked))
        for key, value, crc in reader.execute(
            f"select id, {name}, {name}_crc from details where id in ({marks})", asked
        ):
            if seal(key, value) != crc:
                raise damaged(f"A detail of feature {key & (1 << SHIFT) - 1}")
            found[key] = value
    return [found.get(key) for key in keys] if found else []


def changes(reader: Any, keys: Sequence[int]) -> Float[np.ndarray, "time parameter 3"]:
    """Value, lo and hi of all parameters, NaN where there are none."""
    parts = column(reader, keys, "changes") or [None] * len(keys)
    longest = max((len(part) for part in parts if part), default=0)
    nothing = np.full(longest // 8, np.nan).tobytes()
    whole_rows = (part if part and len(part) == longest else nothing for part in parts)
    table = np.frombuffer(b"".join(whole_rows), "<f8")
    return table.reshape(len(keys), -1, 3)

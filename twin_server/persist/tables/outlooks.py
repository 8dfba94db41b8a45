"""The table of past outlooks: what each twin has stated of its future, as of some readings."""

from typing import Any, NamedTuple

from .checksums import OUTLOOKS
from .statements import ALL_ROWS, insert
from .statements import select as select_rows


class OutlookRow(NamedTuple):
    """An outlook as it is kept.

    Parameters
    ----------
    twin
        SITE.ASSET.
    id
        Of the reading that it was made after: boot number and sequence, as of its features.
    slow_time
        Of that reading.
    body
        The statement, as JSON.
    """

    twin: str
    id: int
    slow_time: float
    body: str


def add(writer: Any, row: OutlookRow, kept: int) -> list[int]:
    """Keep an outlook, and the last `kept` of its twin; return the ids of those that went."""
    insert(writer, OUTLOOKS, [row])
    ids = writer.execute(
        "select id from outlooks where twin = ? order by id desc", (row.twin,)
    ).fetchall()
    gone = [each[0] for each in ids[kept:]]
    writer.executemany(
        "delete from outlooks where twin = ? and id = ?", [(row.twin, each) for each in gone]
    )
    return gone


def forget(writer: Any, twin_id: str) -> list[int]:
    """Drop all of a twin; return their ids."""
    ids = writer.execute("select id from outlooks where twin = ?", (twin_id,)).fetchall()
    writer.execute("delete from outlooks where twin = ?", (twin_id,))
    return [each[0] for each in ids]


def select(reader: Any, twin_id: str, until: int | None, limit: int | None) -> list[OutlookRow]:
    """Read the newest of a twin that were made up to a reading, in order."""
    last = ALL_ROWS if until is None else until
    most = ALL_ROWS if limit is None else limit
    where = "where twin = ? and id <= ?"
    rows = reader.execute(
        f"select id from outlooks {where} order by id desc limit ?", (twin_id, last, most)
    ).fetchall()
    if not rows:
        return []
    asked = (twin_id, rows[-1][0], rows[0][0])
    found = select_rows(reader, OUTLOOKS, "where twin = ? and id between ? and ?", asked)
    return [OutlookRow(*row) for row in found]

"""The table of fatigue messages: the newest of each boot and hour."""

from collections.abc import Iterable
from typing import Any, NamedTuple

from .checksums import FATIGUE, opened
from .statements import insert as insert_rows

HOUR_NS = 3_600 * 10**9
"""One hour [ns]."""


class FatigueRow(NamedTuple):
    """A fatigue message as it is kept; sums since its boot began."""

    twin: str
    boot: str
    hour: int
    sequence: int
    t_ns: int
    message: bytes


def insert(writer: Any, rows: Iterable[FatigueRow]) -> list[FatigueRow]:
    """Keep messages, each in the place of an earlier one of its boot and hour; return them."""
    new = []
    for row in rows:
        kept = writer.execute(
            "select sequence from fatigue where twin = ? and boot = ? and hour = ?", row[:3]
        ).fetchone()
        if kept is not None:
            if kept[0] >= row.sequence:
                continue
            writer.execute(
                "delete from fatigue where twin = ? and boot = ? and hour = ?", row[:3]
            )
        insert_rows(writer, FATIGUE, [row])
        new.append(row)
    return new


def select(reader: Any, twin_id: str) -> list[FatigueRow]:
    """Read all of a twin in the order of time."""
    rows = reader.execute(
        f"select {', '.join(FATIGUE.all_columns)} from fatigue where twin = ? "
        "order by t_ns, sequence",
        (twin_id,),
    )
    return [FatigueRow(*row) for row in opened(FATIGUE, rows)]

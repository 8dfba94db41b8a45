"""The table of messages that were set aside."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from .checksums import QUARANTINE
from .counted import NUMBERED, count_of, next_keys
from .statements import Connection, insert, select


class AsideRow(NamedTuple):
    """A message that was set aside, as it is kept.

    Parameters
    ----------
    number
        Key of the row, 0 before it is kept; people see its `ordinal`.
    boot, sequence
        Of the message.
    set_ns
        When it was set aside [ns since 1970-01-01 UTC].
    key
        Key of the bus under which it came.
    why
        Reason, a clause.
    accepted
        Whether it has its place in the history, without an estimate.
    dropped
        Whether it was dropped: its place in the history stays without an estimate.
    message
        Its bytes.
    """

    number: int
    twin: str
    boot: str
    sequence: int
    set_ns: int
    key: str
    why: str
    accepted: bool
    dropped: bool
    message: bytes

    @property
    def ordinal(self) -> int:
        """Number of the message among those of its twin."""
        return count_of(self.number)


def add(writer: Connection, rows: Sequence[AsideRow]) -> list[tuple[object, ...]]:
    """Keep rows under the next numbers, and return them; what is kept is not kept again."""
    new = []
    for row in rows:
        known = writer.execute(
            "select number from quarantine where twin = ? and boot = ? and sequence = ? "
            "and key = ?",
            (row.twin, row.boot, row.sequence, row.key),
        ).fetchone()
        if known is not None:
            continue
        [key] = next_keys(writer, QUARANTINE, {row.twin: 1})[row.twin]
        new.append(_stored(row._replace(number=key)))
        insert(writer, QUARANTINE, new[-1:])
    return new


def read(reader: Connection, twin_id: str | None, number: int | None) -> list[AsideRow]:
    """Read the rows of a twin, the one of a number of a twin, or all, in order."""
    asked: dict[str, Any] = {"twin = ?": twin_id, NUMBERED: number}
    given = {clause: value for clause, value in asked.items() if value is not None}
    where = f"where {' and '.join(given)}" if given else ""
    rows = select(reader, QUARANTINE, where, tuple(given.values()))
    return [
        AsideRow(*row)._replace(accepted=bool(row[7]), dropped=bool(row[8])) for row in rows
    ]


def remove(writer: Connection, number: int) -> list[tuple[Any, ...]]:
    """Delete a row; return it, or nothing if there is none."""
    rows = select(writer, QUARANTINE, "where number = ?", (number,))
    writer.execute("delete from quarantine where number = ?", (number,))
    return rows


def keep_place(writer: Connection, row: AsideRow) -> list[tuple[object, ...]]:
    """Keep the place of an accepted message that was dropped, without its bytes; return it."""
    rows = [_stored(row._replace(dropped=True, message=b""))] if row.accepted else []
    insert(writer, QUARANTINE, rows)
    return rows


def _stored(row: AsideRow) -> tuple[object, ...]:
    return (*row[:7], int(row.accepted), int(row.dropped), row.message)

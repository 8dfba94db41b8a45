"""The tables of deliveries and acknowledgements, written with the events they follow."""

from collections.abc import Iterable, Sequence
from typing import Any

from slowtime_schemas.answers.alarms import DeliveryState
from twin_server.events.deliveries import OPEN, AlarmAcknowledgement, Delivery, DeliveryTally

from .checksums import ACKNOWLEDGEMENTS, DELIVERIES, SqlTable, opened
from .statements import absent
from .statements import insert as insert_rows

Row = Sequence[Any]


def insert(writer: Any, rows: Iterable[Delivery]) -> list[Row]:
    """Insert deliveries, and return them; one that exists already is left unchanged."""
    return _insert_absent(writer, DELIVERIES, "id", rows)


def settle(writer: Any, rows: Iterable[Delivery]) -> list[Row]:
    """Store outcomes of deliveries that are open, except of deleted twins; return those."""
    assigned = ", ".join(f"{name} = ?" for name in DELIVERIES.all_columns)
    where = f"id = ? and state in ({','.join('?' * len(OPEN))})"
    question = f"update deliveries set {assigned} where {where}"
    return [
        row
        for row in rows
        if writer.execute(question, (*DELIVERIES.sealed(row), row[0], *OPEN)).rowcount
    ]


def acknowledge(writer: Any, rows: Iterable[AlarmAcknowledgement]) -> list[Row]:
    """Store acknowledgements of alarms, and return them; the first of each is kept."""
    return _insert_absent(writer, ACKNOWLEDGEMENTS, "event", rows)


def select(
    reader: Any,
    twin: str | None,
    receiver: str | None,
    states: Sequence[DeliveryState],
    due_ns: int | None,
    limit: int,
) -> list[Delivery]:
    """Read deliveries: those due first, or without `due_ns` the newest first."""
    asked: list[tuple[str, Sequence[object]]] = []
    if states:
        asked.append((f"state in ({','.join('?' * len(states))})", states))
    for clause, value in (
        ("twin = ?", twin),
        ("receiver = ?", receiver),
        ("due_ns <= ?", due_ns),
    ):
        if value is not None:
            asked.append((clause, (value,)))
    where = f"where {' and '.join(clause for clause, _ in asked)}" if asked else ""
    order = "created_ns desc, id" if due_ns is None else "due_ns, id"
    rows = reader.execute(
        f"select {', '.join(DELIVERIES.all_columns)} from deliveries {where} "
        f"order by {order} limit ?",
        (*(value for _, values in asked for value in values), limit),
    )
    return [Delivery(*row) for row in opened(DELIVERIES, rows)]


def tallies(reader: Any) -> list[DeliveryTally]:
    """Count deliveries by twin, receiver and state."""
    rows = reader.execute(
        "select twin, receiver, state, count(*), min(created_ns) from deliveries "
        "group by twin, receiver, state order by twin, receiver, state"
    )
    return [DeliveryTally(*row) for row in rows]


def forget(writer: Any, before_ns: int) -> list[tuple[str, str]]:
    """Drop deliveries that ended before then; return the id and the twin of each."""
    where = "where ended_ns > 0 and ended_ns < ?"
    gone = writer.execute(f"select id, twin from deliveries {where}", (before_ns,)).fetchall()
    writer.execute(f"delete from deliveries {where}", (before_ns,))
    return [(row[0], row[1]) for row in gone]


def acknowledged(reader: Any, twin_id: str) -> dict[str, AlarmAcknowledgement]:
    """Read the acknowledgements of alarms of a twin, by the identity of the event."""
    rows = reader.execute(
        f"select {', '.join(ACKNOWLEDGEMENTS.all_columns)} from acknowledgements "
        "where twin = ? order by t_ns, event",
        (twin_id,),
    )
    return {row[0]: AlarmAcknowledgement(*row) for row in opened(ACKNOWLEDGEMENTS, rows)}


def _insert_absent(writer: Any, table: SqlTable, key: str, rows: Iterable[Row]) -> list[Row]:
    new = absent(writer, table, (key,), rows)
    insert_rows(writer, table, new)
    return new

"""The tables of deliveries and acknowledgements, written with the events they follow."""

from collections.abc import Iterable, Sequence
from typing import Any

from twin_server.events.deliveries import OPEN, Acknowledgement, Delivery, State, Tally

from .checksums import ACKNOWLEDGEMENTS, DELIVERIES, Table, opened


def insert(writer: Any, rows: Iterable[Delivery]) -> None:
    """Insert deliveries; one that exists already is left unchanged."""
    _put(writer, DELIVERIES, rows, "do nothing")


def settle(writer: Any, rows: Iterable[Delivery]) -> None:
    """Store outcomes of deliveries that are open, except of deleted twins."""
    sealed = [DELIVERIES.sealed(row) for row in rows]
    if not sealed:
        return
    assigned = ", ".join(f"{name} = ?" for name in DELIVERIES.all_columns)
    where = f"id = ? and state in ({','.join('?' * len(OPEN))})"
    writer.executemany(
        f"update deliveries set {assigned} where {where}",
        [(*row, row[0], *OPEN) for row in sealed],
    )


def acknowledge(writer: Any, rows: Iterable[Acknowledgement]) -> None:
    """Store acknowledgements of alarms; the first of each is kept."""
    _put(writer, ACKNOWLEDGEMENTS, rows, "do nothing")


def select(
    reader: Any,
    twin: str | None,
    receiver: str | None,
    states: Sequence[State],
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


def tallies(reader: Any) -> list[Tally]:
    """Count deliveries by twin, receiver and state."""
    rows = reader.execute(
        "select twin, receiver, state, count(*), min(created_ns) from deliveries "
        "group by twin, receiver, state order by twin, receiver, state"
    )
    return [Tally(*row) for row in rows]


def forget(writer: Any, before_ns: int) -> None:
    """Drop deliveries that ended before then."""
    writer.execute("delete from deliveries where ended_ns > 0 and ended_ns < ?", (before_ns,))


def acknowledged(reader: Any, twin_id: str) -> dict[str, Acknowledgement]:
    """Read the acknowledgements of alarms of a twin, by the identity of the event."""
    rows = reader.execute(
        f"select {', '.join(ACKNOWLEDGEMENTS.all_columns)} from acknowledgements "
        "where twin = ? order by t_ns, event",
        (twin_id,),
    )
    return {row[0]: Acknowledgement(*row) for row in opened(ACKNOWLEDGEMENTS, rows)}


def _put(writer: Any, table: Table, rows: Iterable[Sequence[object]], otherwise: str) -> None:
    sealed = [table.sealed(row) for row in rows]
    if sealed:
        names = table.all_columns
        writer.executemany(
            f"insert into {table.name} ({', '.join(names)}) "
            f"values ({','.join('?' * len(names))}) on conflict {otherwise}",
            sealed,
        )

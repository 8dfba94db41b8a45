"""Diagnoses and what they found: a table of their own, beside the history."""

import sqlite3
import zlib
from typing import NamedTuple

TABLE = """
create table diagnoses (
  number integer primary key autoincrement,
  twin text not null,
  asked_ns integer not null,
  ended_ns integer,
  state text not null,
  request text not null,
  error text not null,
  report text,
  page blob,
  model text
);
create index diagnoses_of_twin on diagnoses (twin, number);
"""
"""What databases from before there were diagnoses lack."""

_BRIEF = "number, twin, asked_ns, ended_ns, state, request, error, report"


class DiagnosisRow(NamedTuple):
    """A diagnosis as it is kept; `number` counts all of a store, 0 before it is kept.

    Parameters
    ----------
    request, report
        JSON.
    """

    number: int
    twin: str
    asked_ns: int
    ended_ns: int | None
    state: str
    request: str
    error: str = ""
    report: str | None = None


def insert(writer: sqlite3.Connection, row: DiagnosisRow) -> int:
    """Keep one more; give its number."""
    number = writer.execute(
        f"insert into diagnoses ({_BRIEF}) values (null,?,?,?,?,?,?,?)", row[1:]
    ).lastrowid
    assert number is not None
    return number


def update(writer: sqlite3.Connection, row: DiagnosisRow, page: bytes, model: str) -> None:
    """Keep what has become of one; page and model only where they are not empty."""
    writer.execute(
        "update diagnoses set ended_ns = ?, state = ?, error = ?, report = ?, page = ?, "
        "model = ? where number = ?",
        (
            row.ended_ns, row.state, row.error, row.report,
            zlib.compress(page) if page else None, model or None, row.number,
        ),
    )  # fmt: skip


def forget(writer: sqlite3.Connection, twin_id: str, kept: int) -> None:
    """Drop all of a twin but the last `kept`."""
    writer.execute(
        "delete from diagnoses where twin = ? and number not in "
        "(select number from diagnoses where twin = ? order by number desc limit ?)",
        (twin_id, twin_id, kept),
    )


def select(
    reader: sqlite3.Connection, twin_id: str | None, number: int | None
) -> list[DiagnosisRow]:
    """Read those of a twin, or of all, or the one of a number."""
    rows = reader.execute(
        f"select {_BRIEF} from diagnoses where (?1 is null or twin = ?1) and "
        "(?2 is null or number = ?2) order by number",
        (twin_id, number),
    ).fetchall()
    return [DiagnosisRow(*row) for row in rows]


def page_of(reader: sqlite3.Connection, number: int) -> bytes | None:
    """Read the page of one; None where it has none."""
    row = reader.execute("select page from diagnoses where number = ?", (number,)).fetchone()
    return None if row is None or row[0] is None else zlib.decompress(row[0])


def model_of(reader: sqlite3.Connection, number: int) -> str | None:
    """Read the augmented model of one; None where it has none."""
    row = reader.execute("select model from diagnoses where number = ?", (number,)).fetchone()
    return None if row is None else row[0]

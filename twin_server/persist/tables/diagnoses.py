"""The table of diagnoses and their results."""

import zlib
from typing import Any, NamedTuple

from .checksums import DIAGNOSES, Table, damaged, opened, seal
from .statements import insert as insert_rows

_BRIEF = Table("diagnoses", DIAGNOSES.columns[:8], DIAGNOSES.seals[:1], "number")


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


def insert(writer: Any, row: DiagnosisRow) -> tuple[object, ...]:
    """Keep one more under its number, and return all its columns."""
    whole = (*row, None, None)
    insert_rows(writer, DIAGNOSES, [whole])
    return whole


def update(writer: Any, row: DiagnosisRow, page: bytes, model: str) -> list[tuple[object, ...]]:
    """Store the outcome of a diagnosis, page and model only if not empty; return its row.

    There is none where the diagnosis was deleted meanwhile.
    """
    whole = (*row, zlib.compress(page) if page else None, model or None)
    assigned = ", ".join(f"{name} = ?" for name in DIAGNOSES.all_columns)
    question = f"update diagnoses set {assigned} where number = ?"
    there = writer.execute(question, (*DIAGNOSES.sealed(whole), row.number)).rowcount
    return [whole] if there else []


def forget(writer: Any, twin_id: str, kept: int) -> list[int]:
    """Drop all of a twin but the last `kept`; return their numbers."""
    rows = writer.execute(
        "select number from diagnoses where twin = ? order by number desc", (twin_id,)
    ).fetchall()
    gone = [row[0] for row in rows[kept:]]
    writer.executemany("delete from diagnoses where number = ?", [(one,) for one in gone])
    return gone


def select(reader: Any, twin_id: str | None, number: int | None) -> list[DiagnosisRow]:
    """Read those of a twin, or of all, or the one of a number."""
    asked = {"twin = ?": twin_id, "number = ?": number}
    given = {clause: value for clause, value in asked.items() if value is not None}
    where = f"where {' and '.join(given)}" if given else ""
    rows = reader.execute(
        f"select {', '.join(_BRIEF.all_columns)} from diagnoses {where} order by number",
        tuple(given.values()),
    )
    return [DiagnosisRow(*row) for row in opened(_BRIEF, rows)]


def page_of(reader: Any, number: int) -> bytes | None:
    """Read the page of one; None where it has none."""
    page = _files(reader, number)[0]
    return None if page is None else zlib.decompress(page)


def model_of(reader: Any, number: int) -> str | None:
    """Read the augmented model of one; None where it has none."""
    return _files(reader, number)[1]


def _files(reader: Any, number: int) -> tuple[bytes | None, str | None]:
    question = "select page, model, files_crc from diagnoses where number = ?"
    row = reader.execute(question, (number,)).fetchone()
    if row is None:
        return None, None
    if seal(number, row[0], row[1]) != row[2]:
        raise damaged(f"A file of diagnosis {number}")
    return row[0], row[1]

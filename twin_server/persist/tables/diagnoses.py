"""The table of diagnoses and their results."""

import zlib
from typing import Any, NamedTuple

from .checksums import DIAGNOSES, damaged, opened, seal
from .counted import NUMBERED, count_of, next_keys
from .statements import insert as insert_rows

_BRIEF = DIAGNOSES._replace(
    columns=DIAGNOSES.columns[:8], seals=DIAGNOSES.seals[:1], places=DIAGNOSES.places[:1]
)


class DiagnosisRow(NamedTuple):
    """A diagnosis as it is kept; `number` counts those of its twin, 0 before it is kept.

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


def insert(writer: Any, row: DiagnosisRow) -> tuple[Any, ...]:
    """Keep one more under the next number of its twin, and return all its columns."""
    [key] = next_keys(writer, DIAGNOSES, {row.twin: 1})[row.twin]
    whole = (key, *row[1:], None, None)
    insert_rows(writer, DIAGNOSES, [whole])
    return whole


def update(writer: Any, row: DiagnosisRow, page: bytes, model: str) -> list[tuple[Any, ...]]:
    """Store the outcome of a diagnosis, page and model only if not empty; return its row.

    There is none where its twin was deleted meanwhile.
    """
    key = _key_of(writer, row.twin, row.number)
    if key is None:
        return []
    whole = (key, *row[1:], zlib.compress(page) if page else None, model or None)
    assigned = ", ".join(f"{name} = ?" for name in DIAGNOSES.all_columns)
    question = f"update diagnoses set {assigned} where number = ?"
    writer.execute(question, (*DIAGNOSES.sealed(whole), key))
    return [whole]


def forget(writer: Any, twin_id: str, kept: int) -> list[int]:
    """Drop all of a twin but the last `kept`; return their numbers."""
    rows = writer.execute(
        "select number from diagnoses where twin = ? order by number desc", (twin_id,)
    ).fetchall()
    gone = [row[0] for row in rows[kept:]]
    writer.executemany("delete from diagnoses where number = ?", [(one,) for one in gone])
    return gone


def select(reader: Any, twin_id: str | None, number: int | None) -> list[DiagnosisRow]:
    """Read those of a twin, or of all, or the one of a number of a twin."""
    asked = {"twin = ?": twin_id, NUMBERED: number}
    given = {clause: value for clause, value in asked.items() if value is not None}
    where = f"where {' and '.join(given)}" if given else ""
    rows = reader.execute(
        f"select {', '.join(_BRIEF.all_columns)} from diagnoses {where} order by number",
        tuple(given.values()),
    )
    return [DiagnosisRow(count_of(row[0]), *row[1:]) for row in opened(_BRIEF, rows)]


def page_of(reader: Any, twin_id: str, number: int) -> bytes | None:
    """Read the page of one; None where it has none."""
    page = _files(reader, twin_id, number)[0]
    return None if page is None else zlib.decompress(page)


def model_of(reader: Any, twin_id: str, number: int) -> str | None:
    """Read the augmented model of one; None where it has none."""
    return _files(reader, twin_id, number)[1]


def _files(reader: Any, twin_id: str, number: int) -> tuple[bytes | None, str | None]:
    question = (
        f"select number, page, model, files_crc from diagnoses where twin = ? and {NUMBERED}"
    )
    row = reader.execute(question, (twin_id, number)).fetchone()
    if row is None:
        return None, None
    if seal(*row[:3]) != row[3]:
        raise damaged(f"A file of diagnosis {number} of {twin_id}")
    return row[1], row[2]


def _key_of(reader: Any, twin_id: str, number: int) -> int | None:
    question = f"select number from diagnoses where twin = ? and {NUMBERED}"
    row = reader.execute(question, (twin_id, number)).fetchone()
    return None if row is None else int(row[0])

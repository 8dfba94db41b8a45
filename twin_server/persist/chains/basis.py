"""Chains all rows as they stand: after an upgrade, or when an operator says so."""

import itertools
from collections.abc import Iterator
from typing import Any

from slowtime_services.ledger import Entry, states_digest
from slowtime_services.ledger import chain as kinds
from twin_server.persist.tables.checksums import opened
from twin_server.persist.tables.ledger import of_act
from twin_server.persist.tables.search import SHIFT

from .coverage import COVERED
from .journal import Journal

AT_ONCE = 1_000
"""Features whose states one entry covers, and rows that are read at once [1]."""


def renew(writer: Any, journal: Journal) -> None:
    """Note all rows of all tables, each chain behind an entry that says so."""
    for (twin_id,) in writer.execute("select id from twins order by place").fetchall():
        _begin(journal, twin_id)
    for coverage in COVERED.values():
        table = coverage.table
        rows = writer.execute(
            f"select {', '.join(table.all_columns)} from {table.name} order by {table.key}"
        )
        for row in opened(table, rows):
            owner = journal.owner(coverage.owner(row))
            if owner not in journal.entries:
                _begin(journal, owner)
            journal.add(owner, [coverage.written(row)])
    for number, twin_id in writer.execute(
        "select number, twin from runs order by number"
    ).fetchall():
        for key, digest in _states(writer, number):
            journal.add(twin_id, [Entry(kinds.STATES, key, digest)])


def _begin(journal: Journal, owner: str) -> None:
    journal.add(owner, [of_act(kinds.BASIS)])


def _states(writer: Any, number: int) -> Iterator[tuple[int, bytes]]:
    """Yield the first id and the digest of each group of states of a boot."""
    rows = states_between(writer, number << SHIFT, (number + 1 << SHIFT) - 1)
    while part := list(itertools.islice(rows, AT_ONCE)):
        yield part[0][0], states_digest(part)


def states_between(
    reader: Any, first: int, last: int
) -> Iterator[tuple[int, bytes, bytes, bytes]]:
    """Yield id, state and both parts of the detail of the features of some ids, in order."""
    some = reader.execute(
        "select 1 from details where id between ? and ? limit 1", (first, last)
    ).fetchone()
    more = (
        ("changes, body", "left join details d on d.id = f.id") if some else ("null, null", "")
    )
    question = (
        f"select f.id, state, {more[0]} from features f {more[1]} "
        "where f.id between ? and ? order by f.id limit ?"
    )
    while rows := reader.execute(question, (first, last, AT_ONCE)).fetchall():
        for key, state, changes, body in rows:
            yield key, state, changes or b"", body or b""
        first = rows[-1][0] + 1

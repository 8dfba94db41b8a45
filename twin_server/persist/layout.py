"""Makes, migrates and verifies the layout of the database file.

Beside the checksums of rows, triggers keep a tally of each table, how many rows it has and the
sum of their checksums, so that a row that has vanished is noticed as well.
"""

import importlib.resources
import logging
import sqlite3
from collections.abc import Callable, Iterable
from typing import Any

from twin_server.history.states import LAYOUT

from .chains import Journal
from .chains.basis import renew
from .errors import DamagedStoreError
from .tables.checksums import (
    ACKNOWLEDGEMENTS,
    ASSET_EVENTS,
    COMPOSITES,
    DELIVERIES,
    DIAGNOSES,
    DIGESTS,
    EVENTS,
    FATIGUE,
    FEATURES,
    HEADS,
    LEDGER,
    LEVELS,
    NUMBERS,
    OUTLOOKS,
    QUARANTINE,
    TABLES,
    SqlTable,
)
from .tables.digests import HistoryHasher, RollingHash
from .tables.ledger import ChainEnds, build_ledger
from .tables.levels import build
from .tables.statements import insert

logger = logging.getLogger(__name__)

APPLICATION = 0x536C6F77
VERSION = 256 * LAYOUT + 14
"""Layout of the states, and of the tables around them."""

WITH_CURRENT_RUNS = 256 * LAYOUT + 13
"""The version whose rows of boots say all that their features do; all else is the same."""
WITHOUT_OUTLOOKS = 256 * LAYOUT + 12
WITHOUT_CHAINED_ROWS = 256 * LAYOUT + 11
"""The version whose ledger covers registrations, features and reports only."""
WITHOUT_QUARANTINE = 256 * LAYOUT + 10
WITHOUT_COMPOSITES = 256 * LAYOUT + 9
WITHOUT_FATIGUE = 256 * LAYOUT + 8
WITHOUT_ASSET_EVENTS = 256 * LAYOUT + 7
WITHOUT_LEDGER = 256 * LAYOUT + 6
WITHOUT_DELIVERIES = 256 * LAYOUT + 5
WITHOUT_LEVELS = 256 * LAYOUT + 4
"""Versions before, which lack some tables and nothing else."""

_OLDER = tuple(range(256 * LAYOUT + 1, VERSION))
_LATER = (LEDGER, HEADS, ASSET_EVENTS, FATIGUE, COMPOSITES, QUARANTINE, OUTLOOKS)
_OF_ALARMS = (DELIVERIES, ACKNOWLEDGEMENTS, *_LATER)
LACKING: dict[int, tuple[SqlTable, ...]] = {
    WITH_CURRENT_RUNS: (),
    WITHOUT_OUTLOOKS: (OUTLOOKS,),
    WITHOUT_CHAINED_ROWS: (OUTLOOKS,),
    WITHOUT_QUARANTINE: _LATER[5:],
    WITHOUT_COMPOSITES: _LATER[4:],
    WITHOUT_FATIGUE: _LATER[3:],
    WITHOUT_ASSET_EVENTS: _LATER[2:],
    WITHOUT_LEDGER: _LATER,
    WITHOUT_DELIVERIES: _OF_ALARMS,
    WITHOUT_LEVELS: (LEVELS, DIGESTS, *_OF_ALARMS),
}
"""Tables that a database of a version before lacks."""


Tell = Callable[[str, int], None]


def schema() -> str:
    """Return the statements that make an empty database."""
    text = importlib.resources.files(__package__).joinpath("schema.sql").read_text()
    return text + _TALLIES + "".join(_triggers(table) for table in TABLES)


def postgres_schema() -> str:
    """Write the same tables for PostgreSQL; it keeps checksums of pages instead of tallies."""
    text = importlib.resources.files(__package__).joinpath("schema.sql").read_text()
    return _for_postgres(text) + "create table layouts (version bigint not null);" + _ATTEMPTS


def postgres_lacking(version: int) -> str:
    """Write the tables that a PostgreSQL database of a version before lacks."""
    return _for_postgres("".join(_making(LACKING[version]))) + _ATTEMPTS


def _for_postgres(text: str) -> str:
    for ours, theirs in (
        (" integer", " bigint"),
        (" real", " double precision"),
        (" blob", " bytea"),
    ):
        text = text.replace(ours, theirs)
    return text


def _making(tables: Iterable[SqlTable]) -> Iterable[str]:
    """Statements of the schema that make some tables and their indices."""
    begins = tuple(f"create table {t.name} " for t in tables)
    indices = tuple(f"create index {t.name}_" for t in tables)
    text = importlib.resources.files(__package__).joinpath("schema.sql").read_text()
    for statement in _statements(text):
        # A comment belongs to the statement behind it, and to how SQLite keeps that.
        made = statement[statement.index("create ") :]
        if made.startswith((*begins, *indices)):
            yield made


_ATTEMPTS = "create table if not exists attempts (what text primary key, body bytea not null);"
"""What a server is about to do (`attempts.RowNote`); beside SQLite it is a file."""

_TALLIES = """
create table tallies (
  what text primary key,
  rows integer not null,
  total integer not null
) without rowid;
"""


def _triggers(table: SqlTable) -> str:
    new, old = (
        f"({' + '.join(f'{which}.{name}' for name, _ in table.seals)})"
        for which in ("new", "old")
    )
    name = table.name
    return f"""
insert into tallies values ('{name}', 0, 0);
create trigger {name}_come after insert on {name} begin
  update tallies set rows = rows + 1, total = total + {new} where what = '{name}';
end;
create trigger {name}_change after update on {name} begin
  update tallies set total = total + {new} - {old} where what = '{name}';
end;
create trigger {name}_go after delete on {name} begin
  update tallies set rows = rows - 1, total = total - {old} where what = '{name}';
end;
"""


def damages(
    reader: sqlite3.Connection, tell: Tell | None = None
) -> tuple[list[str], dict[str, RollingHash]]:
    """Return all damage of pages, tables, rows and hashes; empty if there is none.

    And of each twin the hash of its history, which the same pass has rolled.
    """
    found = [row[0] for row in reader.execute("pragma integrity_check(5)") if row[0] != "ok"]
    if found or (found := _changed(reader)):
        return found, {}
    tallies = {what: rest for what, *rest in reader.execute("select * from tallies")}
    try:
        roller = HistoryHasher(reader)
    except DamagedStoreError as error:
        return [str(error)], {}
    for table in TABLES:
        rows, total = 0, 0
        count = len(table.columns)
        for row in all_rows(reader, table):
            if not table.is_sound(row):
                found.append(f"the row {row[0]!r:.40} of {table.name} is not as it was written")
            elif table is FEATURES:
                roller.take(row[0], row[3], row[4])
            rows, total = rows + 1, total + sum(row[count:])
        if not found and tallies.get(table.name) != [rows, total]:
            found.append(f"rows of {table.name} are missing")
        if tell is not None:
            tell(table.name, rows)
    return found or roller.wrong, roller.found


def all_rows(reader: Any, table: SqlTable) -> Iterable[tuple[Any, ...]]:
    """Read a table, features in the order of their ids."""
    question = f"select {', '.join(table.all_columns)} from {table.name}"
    rows: Iterable[tuple[Any, ...]] = reader.execute(
        f"{question} order by id" if table is FEATURES else question
    )
    return rows


def _changed(reader: sqlite3.Connection) -> list[str]:
    """Name tables, indices and triggers that differ from the layout."""
    with sqlite3.connect(":memory:") as fresh:
        fresh.executescript(schema())
        # A database of version 3 or older keeps this one for good.
        question = (
            "select type, name, tbl_name, sql from sqlite_master "
            "where name <> 'sqlite_sequence'"
        )
        wanted = set(fresh.execute(question))
    fresh.close()
    given = set(reader.execute(question))
    return [f"{kind} {name} is not as it was made" for kind, name, *_ in wanted ^ given]


def bring_up_to_date(writer: sqlite3.Connection, version: int) -> bool:
    """Copy the rows of an older version into new tables, all at once; False if too foreign."""
    if version not in _OLDER:
        return False
    if version in LACKING:
        _add_lacking(writer, version)
        return True
    names = [
        row[0]
        for row in writer.execute(
            "select name from sqlite_master where type = 'table' and name not like 'sqlite_%'"
        )
    ]
    writer.execute("begin immediate")
    try:
        for name in names:
            writer.execute(f"alter table {name} rename to old_{name}")
        for name in ("runs_of_twin", "events_of_twin", "diagnoses_of_twin"):
            writer.execute(f"drop index if exists {name}")
        for statement in _statements(schema()):
            writer.execute(statement)
        for table in TABLES:
            if table.name in names:
                insert(writer, table, _old_rows(writer, table))
        _number_as_before(writer, names)
        build_levels(writer)
        build_ledger(writer)
        chain_rows(writer)
        for name in names:
            writer.execute(f"drop table old_{name}")
        writer.execute(f"pragma user_version={VERSION}")
        writer.execute("commit")
    except BaseException:
        if writer.in_transaction:
            writer.execute("rollback")
        raise
    return True


def build_levels(writer: Any) -> None:
    """Make the buckets of all boots out of their features."""
    numbers = [row[0] for row in writer.execute("select number from runs order by number")]
    if numbers:
        logger.info("Computing the buckets of the histories of %d boots, once.", len(numbers))
    for number in numbers:
        build(writer, number)


def chain_rows(writer: Any) -> None:
    """Chain all rows of an older version as they stand: what came before is not covered."""
    journal, ends = Journal(writer), ChainEnds()
    renew(writer, journal)
    ends.append(writer, journal.entries)


def _add_lacking(writer: sqlite3.Connection, version: int) -> None:
    """Add the tables that an older version lacks, in one transaction."""
    tables = LACKING[version]
    writer.execute("begin immediate")
    try:
        for statement in _making(tables):
            writer.execute(statement)
        for table in tables:
            for statement in _statements(_triggers(table)):
                writer.execute(statement)
        if LEVELS in tables:
            build_levels(writer)
        if LEDGER in tables:
            build_ledger(writer)
        if version < WITH_CURRENT_RUNS:
            chain_rows(writer)
        writer.execute(f"pragma user_version={VERSION}")
        writer.execute("commit")
    except BaseException:
        if writer.in_transaction:
            writer.execute("rollback")
        raise


def _old_rows(writer: sqlite3.Connection, table: SqlTable) -> Iterable[tuple[object, ...]]:
    return writer.execute(f"select {', '.join(table.columns)} from old_{table.name}")


def _number_as_before(writer: sqlite3.Connection, names: Iterable[str]) -> None:
    """Keep numbers of events and diagnoses unique."""
    if "sqlite_sequence" not in {
        r[0] for r in writer.execute("select name from sqlite_master")
    }:
        return
    last = dict(writer.execute("select name, seq from sqlite_sequence").fetchall())
    for what, table in (("event", EVENTS), ("diagnosis", DIAGNOSES)):
        value = last.get(f"old_{table.name}", last.get(table.name))
        if value is not None:
            insert(writer, NUMBERS, [(what, value)])


def _statements(script: str) -> Iterable[str]:
    """Split a script into statements: `executescript` would commit the open transaction."""
    part = ""
    for line in script.splitlines(keepends=True):
        part += line
        if sqlite3.complete_statement(part):
            yield part
            part = ""

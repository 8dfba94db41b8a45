"""Layout of the SQLite file: how it is made, brought up to date, and looked through.

Beside the checksums of rows, triggers keep a tally of each table, how many rows it has and the
sum of their checksums, so that a row that has vanished is noticed as well.
"""

import importlib.resources
import sqlite3
from collections.abc import Callable, Iterable

from twin_server.states import LAYOUT

from .sealing import DIAGNOSES, EVENTS, NUMBERS, TABLES, Table
from .sql import insert_all

APPLICATION = 0x536C6F77
VERSION = 256 * LAYOUT + 4
"""Layout of the states, and of the tables around them."""

_OLDER = tuple(range(256 * LAYOUT + 1, VERSION))
_AT_ONCE = 2_000

Tell = Callable[[str, int], None]


def schema() -> str:
    """All that makes an empty database."""
    text = importlib.resources.files(__package__).joinpath("schema.sql").read_text()
    return text + _TALLIES + "".join(_triggers(table) for table in TABLES)


def postgres_schema() -> str:
    """Write the same tables for PostgreSQL; it keeps checksums of pages instead of tallies."""
    text = importlib.resources.files(__package__).joinpath("schema.sql").read_text()
    for ours, theirs in (
        (" integer", " bigint"),
        (" real", " double precision"),
        (" blob", " bytea"),
    ):
        text = text.replace(ours, theirs)
    return text + "create table layouts (version bigint not null);"


_TALLIES = """
create table tallies (
  what text primary key,
  rows integer not null,
  total integer not null
) without rowid;
"""


def _triggers(table: Table) -> str:
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


def damages(reader: sqlite3.Connection, tell: Tell | None = None) -> list[str]:
    """All that is not as it was written: pages, tables, rows; empty where all is sound."""
    found = [row[0] for row in reader.execute("pragma integrity_check(5)") if row[0] != "ok"]
    if found or (found := _changed(reader)):
        return found
    tallies = {what: rest for what, *rest in reader.execute("select * from tallies")}
    for table in TABLES:
        rows, total = 0, 0
        count = len(table.columns)
        for row in reader.execute(f"select {', '.join(table.all_columns)} from {table.name}"):
            if not table.is_sound(row):
                found.append(f"the row {row[0]!r:.40} of {table.name} is not as it was written")
            rows, total = rows + 1, total + sum(row[count:])
        if not found and tallies.get(table.name) != [rows, total]:
            found.append(f"rows of {table.name} are missing")
        if tell is not None:
            tell(table.name, rows)
    return found


def _changed(reader: sqlite3.Connection) -> list[str]:
    """Name what differs from the tables, indices and triggers that there should be."""
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
                insert_all(writer, table, _old_rows(writer, table))
        _number_as_before(writer, names)
        for name in names:
            writer.execute(f"drop table old_{name}")
        writer.execute(f"pragma user_version={VERSION}")
        writer.execute("commit")
    except BaseException:
        if writer.in_transaction:
            writer.execute("rollback")
        raise
    return True


def _old_rows(writer: sqlite3.Connection, table: Table) -> Iterable[tuple[object, ...]]:
    return writer.execute(f"select {', '.join(table.columns)} from old_{table.name}")


def _number_as_before(writer: sqlite3.Connection, names: Iterable[str]) -> None:
    """Give no number of an event or a diagnosis a second time."""
    if "sqlite_sequence" not in {
        r[0] for r in writer.execute("select name from sqlite_master")
    }:
        return
    last = dict(writer.execute("select name, seq from sqlite_sequence").fetchall())
    for what, table in (("event", EVENTS), ("diagnosis", DIAGNOSES)):
        value = last.get(f"old_{table.name}", last.get(table.name))
        if value is not None:
            insert_all(writer, NUMBERS, [(what, value)])


def _statements(script: str) -> Iterable[str]:
    """Cut a script into statements: `executescript` would commit what it begins in."""
    part = ""
    for line in script.splitlines(keepends=True):
        part += line
        if sqlite3.complete_statement(part):
            yield part
            part = ""

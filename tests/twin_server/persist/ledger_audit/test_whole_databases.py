"""Forgeries of more than one row or table, against a head that was kept elsewhere before."""

import contextlib
import hashlib
import itertools
import json
import re
import shutil
import sqlite3

import numpy as np
import pytest

from slowtime_services.credentials import make_key
from slowtime_services.ledger import Entry, states_digest
from slowtime_services.ledger import chain as kinds
from tests.twin_server.persist.tables.test_levels import cut_of, states_of
from twin_server.persist import TwinRow, WriteBatch, audit, audit_file, backup, restore
from twin_server.persist.chains import COVERED
from twin_server.persist.layout import LACKING, VERSION, build_levels
from twin_server.persist.tables.checksums import TABLES
from twin_server.persist.tables.ledger import ChainEnds, of_act

from . import forging


@pytest.fixture(scope="module")
def key(tmp_path_factory):
    path = tmp_path_factory.mktemp("key") / "ledger.pem"
    return path, make_key(path)


@pytest.fixture(scope="module")
def house(tmp_path_factory, key):
    return forging.build(tmp_path_factory.mktemp("house") / "twin.sqlite", key[0])


@pytest.fixture
def copy(house, tmp_path):
    """The house in a file of its own."""
    path = tmp_path / "twin.sqlite"
    shutil.copyfile(house.database, path)
    return forging.House(path, house.key, house.kept, house.old, house.known)


def checked(house, key):
    return audit_file(house.database, public=key[1], kept=house.kept)


@contextlib.contextmanager
def writing(house):
    with contextlib.closing(forging.open_unverified(house.database)) as store:
        with store._writing() as writer:
            yield writer


def all_rows(writer, table):
    return forging._read(writer, table)


def put_all(writer, table, rows):
    writer.execute(f"delete from {table.name}")
    for row in rows:
        forging.put(writer, table, row)


def exchange_two_twins(house):
    """All rows of one twin are the other's, chains among them."""
    names = dict(zip(forging.SITES, reversed(list(forging.SITES)), strict=True))
    parts = {one.split(".")[k]: names[one].split(".")[k] for one in names for k in (0, 1)}
    with writing(house) as writer:
        for table in TABLES:
            columns = table.columns
            if not {"twin", "site"} & set(columns):
                continue
            rows = []
            for row in all_rows(writer, table):
                told = dict(zip(columns, row, strict=True))
                for name in ("twin", "id"):
                    told |= {name: names[told[name]]} if told.get(name) in names else {}
                for name in ("site", "asset"):
                    told |= {name: parts[told[name]]} if name in told else {}
                rows.append(tuple(told[name] for name in columns))
            put_all(writer, table, rows)


def exchange_two_boots(house):
    """Each twin has what the other measured."""
    with writing(house) as writer:
        for name in ("features", "details", "digests"):
            table = forging.BY_NAME[name]
            put_all(
                writer,
                table,
                [
                    ((3 - (row[0] >> 40) << 40) | row[0] & (1 << 40) - 1, *row[1:])
                    for row in all_rows(writer, table)
                ],
            )
        writer.execute("delete from levels")
        build_levels(writer)


def remove_a_twin_with_its_chain(house):
    with writing(house) as writer:
        _remove_twin(writer, "lab.beam", 1)
        writer.execute("delete from ledger where twin = 'lab.beam'")


def _remove_twin(writer, twin, number):
    first, last = number << 40, (number + 1 << 40) - 1
    for name in ("features", "details", "digests", "levels"):
        writer.execute(f"delete from {name} where id between ? and ?", (first, last))
    writer.execute("delete from held where number = ?", (number,))
    for table in TABLES:
        if "twin" in table.columns and table.name != "ledger":
            writer.execute(f"delete from {table.name} where twin = ?", (twin,))
    writer.execute("delete from twins where id = ?", (twin,))


def remove_a_twin_and_its_heads(house):
    """Heads behind the one that was kept are removed, too."""
    remove_a_twin_with_its_chain(house)
    with writing(house) as writer:
        writer.execute("delete from heads where number > ?", (house.kept.number,))


def say_that_a_twin_was_deleted(house):
    with writing(house) as writer:
        _remove_twin(writer, "lab.beam", 1)
        ChainEnds().append(writer, {"lab.beam": [of_act(kinds.DELETED)]})


def _scaled(writer):
    from twin_server.history.states import from_bytes

    table = forging.BY_NAME["features"]
    rows = []
    for row in all_rows(writer, table):
        one = from_bytes([row[4]]).copy()
        one["stiffness_change"] *= 0.1
        rows.append((*row[:4], one.tobytes()))
    put_all(writer, table, rows)
    writer.execute("delete from levels")
    build_levels(writer)
    return rows


def say_that_states_were_estimated_anew(house):
    """Entries behind the last head vouch for scaled states; a chain needs no key."""
    with writing(house) as writer:
        details = {row[0]: row[1:] for row in all_rows(writer, forging.BY_NAME["details"])}
        rows = [
            (row[0], row[4], *details.get(row[0], (b"", b"")))
            for row in _scaled(writer)
            if row[0] >> 40 == 1
        ]
        writer.execute("delete from digests where id < ?", (2 << 40,))
        states = Entry(kinds.STATES, rows[0][0], states_digest(rows))
        ChainEnds().append(writer, {"lab.beam": [of_act(kinds.ANEW), states]})


def chain_all_anew(house):
    """The rows are scaled, and chained by this software as an upgrade would."""
    with writing(house) as writer:
        _scaled(writer)
    with contextlib.closing(forging.open_unverified(house.database)) as store:
        store.renew_basis()


def pretend_an_older_version(house):
    """The next start brings the database up to date, and chains what it finds."""
    with writing(house) as writer:
        _scaled(writer)
    with contextlib.closing(sqlite3.connect(house.database)) as writer:
        for table in LACKING[VERSION - 2]:
            writer.execute(f"drop table {table.name}")
            writer.execute(f"delete from tallies where what = '{table.name}'")
        writer.execute(f"pragma user_version = {VERSION - 2}")
        writer.commit()
    with contextlib.closing(forging.open_unverified(house.database)):
        pass


def remove_an_event_with_an_entry(house):
    coverage = COVERED["events"]
    with writing(house) as writer:
        row = all_rows(writer, coverage.table)[0]
        forging.remove(writer, coverage.table, row)
        ChainEnds().append(writer, {row[1]: [coverage.removed(row)]})


def move_acknowledgements_to_other_alarms(house):
    table = forging.BY_NAME["acknowledgements"]
    with writing(house) as writer:
        rows = all_rows(writer, table)
        of_beam = [row for row in rows if row[1] == "lab.beam"]
        moved = [
            (b[0], *a[1:]) for a, b in zip(of_beam, of_beam[1:] + of_beam[:1], strict=True)
        ]
        put_all(writer, table, [row for row in rows if row not in of_beam] + moved)


def give_deliveries_to_no_twin(house):
    table = forging.BY_NAME["deliveries"]
    with writing(house) as writer:
        put_all(writer, table, [(row[0], "", *row[2:]) for row in all_rows(writer, table)])


def take_the_chain_of_another(house):
    with writing(house) as writer:
        writer.execute("delete from ledger where twin = 'lab.beam'")
        table = forging.BY_NAME["ledger"]
        for row in all_rows(writer, table):
            if row[0] == "yard.mast":
                forging.put(writer, table, ("lab.beam", *row[1:]))


def take_the_heads_of_another_database(house):
    """Signed with the same key, over other chains."""
    other = house.database.with_name("other.sqlite")
    with contextlib.closing(forging.open_unverified(other)) as store:
        signer = forging.signer_of(store, house.key)
        for turn in range(3):
            store.write(WriteBatch(twins=[TwinRow("lab", "beam", "{}", f"{turn}")]))
            assert signer.sign(10**18 + turn) is not None
        heads = forging.rows_of(store, forging.BY_NAME["heads"])
    with writing(house) as writer:
        put_all(writer, forging.BY_NAME["heads"], heads)


def copy_rows_and_chains_of_before(house):
    """Rows, chains and heads are those of an old copy."""
    with writing(house) as writer:
        for table in TABLES:
            put_all(writer, table, house.old[table.name])


def launder_through_a_backup(house):
    forging.forge(house, forging.edit, forging.BY_NAME["events"])
    copy = house.database.with_name("backup.sqlite")
    backup(house.database, copy)
    house.database.unlink()
    restore(copy, house.database)


FORGERIES = (
    exchange_two_twins, exchange_two_boots, remove_a_twin_with_its_chain,
    remove_a_twin_and_its_heads, say_that_a_twin_was_deleted,
    say_that_states_were_estimated_anew, chain_all_anew, pretend_an_older_version,
    remove_an_event_with_an_entry, move_acknowledgements_to_other_alarms,
    give_deliveries_to_no_twin, take_the_chain_of_another, take_the_heads_of_another_database,
    copy_rows_and_chains_of_before, launder_through_a_backup,
)  # fmt: skip


@pytest.mark.parametrize("forge", FORGERIES, ids=lambda forge: forge.__name__)
def test_a_rewritten_database_is_found_and_not_signed_after_a_restart(copy, key, forge):
    forge(copy)
    found = checked(copy, key)
    assert found.wrong
    with contextlib.closing(forging.open_unverified(copy.database)) as store:
        witness = copy.database.with_name("heads.jsonl")
        witness.write_text(json.dumps(copy.kept._asdict()) + "\n")
        signer = forging.signer_of(store, copy.key, witness_file=witness)
        store.write(cut_of(1, states_of(np.arange(2_000, 2_010))))
        is_old_copy = forge in (
            copy_rows_and_chains_of_before,
            take_the_heads_of_another_database,
        )
        assert is_old_copy or signer.refusal
        signer.sign(2 * 10**18)
    assert checked(copy, key).wrong


def test_rows_in_another_order_are_the_same_rows(copy, key):
    """Tables without a number as their key keep rows in the order in which they were put in."""
    with writing(copy) as writer:
        for table in TABLES:
            rows = all_rows(writer, table)
            put_all(writer, table, rows[::-1])
    assert checked(copy, key).wrong == []


def as_it_is_hashed(value):
    if isinstance(value, bytes):
        return "blob " + hashlib.sha256(value).hexdigest()
    return "\0none" if value is None else str(value).encode()


def nothing(value):
    return "\0none" if value is None else None


TYPED = [name for name in forging.BY_NAME if name not in ("ledger", "heads")]


@pytest.mark.parametrize("name", TYPED)
def test_a_value_of_another_type_is_found(copy, key, name):
    """SQLite keeps a text in a column of blobs, where its owner's rules are taken away."""
    table = forging.BY_NAME[name]
    with contextlib.closing(sqlite3.connect(copy.database, isolation_level=None)) as writer:
        row = forging.candidates(copy, writer, table)[0]
        _let_anything_in(writer, name)
        columns = [one for one in table.columns if one not in forging.keys_of(table)]
        for column, other in itertools.product(columns, (as_it_is_hashed, nothing)):
            value = other(row[table.columns.index(column)])
            writer.execute("begin")
            forging.remove(writer, table, row)
            forging.put(writer, table, forging.with_column(table, row, column, value))
            found = audit(writer, public=key[1], kept=copy.kept)
            writer.execute("rollback")
            assert any(name in what for what in found.wrong), (column, other)


def _let_anything_in(writer, name):
    """Take the rule `not null` from the columns of a table."""
    [sql] = writer.execute("select sql from sqlite_master where name = ?", (name,)).fetchone()
    version = writer.execute("pragma schema_version").fetchone()[0]
    writer.execute("pragma writable_schema = on")
    writer.execute(
        "update sqlite_master set sql = ? where name = ?", (re.sub(" not null", "", sql), name)
    )
    writer.execute(f"pragma schema_version = {version + 1}")
    writer.execute("pragma writable_schema = off")


def test_rows_that_were_written_again_behind_the_head_are_counted_as_uncovered(copy, key):
    """A chain needs no key: who has none cannot tell the server's entries from a forger's."""
    found = checked(copy, key)
    assert (found.wrong, found.replaced["deliveries"]) == ([], 0)
    assert found.replaced["twins"] == 2
    coverage = COVERED["deliveries"]
    with writing(copy) as writer:
        row = next(one for one in all_rows(writer, coverage.table) if one[8] == "waiting")
        changed = forging.with_column(coverage.table, row, "body", "{}")
        forging.remove(writer, coverage.table, row)
        forging.put(writer, coverage.table, changed)
        ChainEnds().append(writer, {row[1]: [coverage.written(changed)]})
    found = checked(copy, key)
    assert (found.wrong, found.replaced["deliveries"]) == ([], 1)


def test_a_twin_that_was_deleted_and_registered_again_is_named(copy, key):
    with contextlib.closing(forging.open_unverified(copy.database)) as store:
        signer = forging.signer_of(store, copy.key)
        assert store.delete("lab.beam")
        store.write(WriteBatch(twins=[TwinRow("lab", "beam", "{}", "{}")]))
        assert signer.sign(2 * 10**18) is not None
    found = checked(copy, key)
    assert found.wrong == []
    [note] = found.notes
    assert "lab.beam: it was deleted with its history" in note

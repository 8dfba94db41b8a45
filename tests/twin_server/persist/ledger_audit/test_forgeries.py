"""Each table, forged in each way, is found against a head that was kept elsewhere before."""

import contextlib
import re
import secrets
import shutil
import sqlite3

import numpy as np
import pytest

from slowtime_services.credentials import make_key
from tests.postgres import schema_of
from tests.twin_server.persist.tables.test_levels import cut_of, states_of
from twin_server.persist import audit, audit_file
from twin_server.persist.chains import COVERED, FOLLOWING
from twin_server.persist.layout import postgres_schema, schema
from twin_server.persist.tables.checksums import TABLES

from . import forging

NAMES = [table.name for table in TABLES]
MADE_BY_THE_LAYOUT = {
    "tallies": "numbers of rows, kept by triggers; `slowtime db check` compares them",
    "layouts": "version of a PostgreSQL schema",
    "attempts": "what a server is about to do, for the time of one step; shown to nobody",
}


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


def checked(house, key, kept=None):
    return audit_file(house.database, public=key[1], kept=kept or house.kept)


def assert_found(found, table, rows):
    """The forgery is found, and nobody else's chain is blamed."""
    assert found.wrong
    named = " ".join(found.wrong)
    owners = forging.owners_of(table, rows)
    if owners and table.name != "ledger":
        assert found.by_chain
        assert found.by_chain.keys() <= owners
    assert (
        any(owner and owner in named for owner in owners)
        or table.name in named
        or (table.name == "heads" and "head" in named)
    )


def test_every_table_of_the_layout_is_covered_or_has_a_reason():
    made = re.findall(r"create table (?:if not exists )?(\w+)", schema() + postgres_schema())
    assert set(made) == {*COVERED, *FOLLOWING, *MADE_BY_THE_LAYOUT}
    assert set(NAMES) == {*COVERED, *FOLLOWING}
    assert not COVERED.keys() & FOLLOWING.keys()


def test_the_house_uses_every_table(house):
    assert all(len(house.known[name]) >= 2 for name in NAMES), {
        name: len(rows) for name, rows in house.known.items()
    }


def test_what_nobody_touched_is_sound_and_what_lies_behind_is_uncovered(house, key):
    against_last = audit_file(house.database, public=key[1])
    found = checked(house, key)
    assert (found.wrong, found.notes) == ([], [])
    assert (found.against.number, found.last.number) == (2, 3)
    assert found.waiting > against_last.waiting > 0
    assert found.vouched + found.waiting == against_last.vouched + against_last.waiting


@pytest.mark.parametrize("act", forging.ACTS, ids=lambda act: act.__name__)
@pytest.mark.parametrize("name", NAMES)
def test_a_forged_table_is_found(copy, key, name, act):
    table = forging.BY_NAME[name]
    rows = forging.forge(copy, act, table)
    assert_found(checked(copy, key), table, rows)


COLUMNS = [
    (table.name, column)
    for table in TABLES
    for column in table.columns
    if column not in forging.keys_of(table)
]


@pytest.mark.long
@pytest.mark.parametrize(("name", "column"), COLUMNS)
def test_no_column_can_be_changed(copy, key, name, column):
    table = forging.BY_NAME[name]
    forging.forge(copy, forging.edit, table, column=column)
    assert checked(copy, key).wrong


def restart_and_go_on(house, times=2):
    """Start a server with the key on a forged database, let readings come, and end it."""
    refusals = []
    for turn in range(times):
        store = forging.open_unverified(house.database)
        with contextlib.closing(store):
            signer = forging.signer_of(store, house.key)
            states = states_of(np.arange(2_000 + 10 * turn, 2_010 + 10 * turn))
            store.write(cut_of(1, states))
            signer.sign(2 * 10**18 + turn)
            signer.close()
            refusals.append(signer.refusal)
    return refusals


LAUNDERED = [name for name in NAMES if name not in ("runs", "heads", "ledger")]


@pytest.mark.parametrize("name", LAUNDERED)
def test_a_forgery_is_not_laundered_through_restarts(copy, key, name):
    table = forging.BY_NAME[name]
    rows = forging.forge(copy, forging.edit, table)
    refusals = restart_and_go_on(copy)
    assert all("not signed any more" in refusal for refusal in refusals)
    found = checked(copy, key)
    assert_found(found, table, rows)
    assert found.last.number == 3


def test_a_server_that_goes_on_with_a_sound_database_signs(copy, key):
    assert restart_and_go_on(copy) == ["", ""]
    found = checked(copy, key)
    assert found.wrong == []
    assert found.last.number == 5


def test_forged_rows_with_forged_entries_are_not_signed(copy, key):
    """Chains need no key: a forger may put an entry of his row behind the last head."""
    table = forging.BY_NAME["deliveries"]

    def with_entry(house, writer, table):
        [row] = forging.edit(house, writer, table)
        changed = forging.with_column(table, row, "body", row[-1] + "x")
        ends.append(writer, {row[1]: [COVERED["deliveries"].written(changed)]})
        return [row]

    from twin_server.persist.tables.ledger import ChainEnds

    ends = ChainEnds()
    forging.forge(copy, with_entry, table)
    # Without the key, what lies behind the head cannot be told from what a server wrote.
    assert checked(copy, key).wrong == []
    refusals = restart_and_go_on(copy)
    assert all("carry no seal of this key" in refusal for refusal in refusals)


@pytest.fixture(scope="module")
def postgres_house(request, key):
    url = schema_of(request.getfixturevalue("postgres"), f"s{secrets.token_hex(6)}")
    return forging.build(url, key[0])


@pytest.mark.long
@pytest.mark.parametrize("act", forging.ACTS, ids=lambda act: act.__name__)
@pytest.mark.parametrize("name", NAMES)
def test_a_forged_table_is_found_in_postgres(postgres_house, key, name, act):
    table, house = forging.BY_NAME[name], postgres_house
    store = forging.open_unverified(house.database)
    with contextlib.closing(store), contextlib.suppress(ZeroDivisionError):
        with store._writing() as writer:
            rows = act(house, writer, table)
            found = audit(writer, public=key[1], kept=house.kept)
            assert_found(found, table, rows)
            raise ZeroDivisionError  # roll back: the next forgery begins from sound tables
    # What was rolled back is sound again.
    if (name, act) == (NAMES[-1], forging.ACTS[-1]):
        with contextlib.closing(forging.open_unverified(house.database)) as store:
            with store.snapshot() as reader:
                assert audit(reader, public=key[1], kept=house.kept).wrong == []


def test_states_that_were_all_scaled_are_found_after_a_restart(copy, key):
    """The forgery of all stiffness states, checksums, buckets and hashes made anew."""
    from twin_server.history.states import from_bytes
    from twin_server.persist.tables.checksums import seal

    with contextlib.closing(sqlite3.connect(copy.database, isolation_level=None)) as writer:
        for row_id, state in writer.execute("select id, state from features").fetchall():
            one = from_bytes([state]).copy()
            one["stiffness_change"] *= 0.1
            forged = one.tobytes()
            writer.execute(
                "update features set state = ?, state_crc = ? where id = ?",
                (forged, seal(row_id, forged), row_id),
            )
    refusals = restart_and_go_on(copy)
    assert all("states of features" in refusal for refusal in refusals)
    assert any("lab.beam: the states of features" in one for one in checked(copy, key).wrong)
    assert any("yard.mast: the states of features" in one for one in checked(copy, key).wrong)


@pytest.mark.parametrize("restarts", [0, 2])
def test_a_backup_put_in_the_place_of_the_database_is_found(house, key, tmp_path, restarts):
    old = forging.build(tmp_path / "twin.sqlite", key[0], turns=1)
    restart_and_go_on(old, restarts)
    there = "has another there" if restarts else "ends at head 1"
    [wrong] = audit_file(old.database, public=key[1], kept=house.kept).wrong
    assert wrong == f"head 2, which was kept elsewhere, is not in the ledger, which {there}"

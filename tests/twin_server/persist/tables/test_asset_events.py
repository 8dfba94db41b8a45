"""What people have told of assets is kept once, in order, and vouched for by the ledger."""

import contextlib
import sqlite3

import pytest

from slowtime_services.clock import HandClock
from slowtime_services.credentials import Signer, make_key
from twin_server.events.asset_events import AssetEventRow
from twin_server.persist import SqliteStore, TwinRow, WriteBatch, audit_file, open_store
from twin_server.persist.tables.checksums import ASSET_EVENTS
from twin_server.pipeline.ingestion.ledger_signer import LedgerSigner
from twin_server.settings import LedgerSettings

TWIN = TwinRow("lab", "beam", "{}", "{}")
ROWS = [
    AssetEventRow("lab.beam", name, number, 10 * number, "ann", f'{{"n":{number}}}')
    for number, name in enumerate(("b", "a", "c"), start=1)
]


def test_events_are_kept_in_the_order_of_their_acceptance_and_the_first_stays(database):
    with contextlib.closing(open_store(database())) as store:
        store.write(WriteBatch(twins=[TWIN], asset_events=ROWS[:2]))
        store.write(WriteBatch(asset_events=[ROWS[2], ROWS[0]._replace(body="{}")]))
        assert store.asset_events("lab.beam") == ROWS
        assert store.asset_events("lab.mast") == []
    with contextlib.closing(open_store(database())) as store:
        assert store.asset_events("lab.beam") == ROWS
        store.delete("lab.beam")
        assert store.asset_events("lab.beam") == []


def signed(path, key):
    """A database with events under a signed head."""
    store = SqliteStore(path)
    signer = LedgerSigner(
        store, HandClock(10**18), Signer.read(key), LedgerSettings(), lambda *_: None
    )
    store.write(WriteBatch(twins=[TWIN]))
    store.write(WriteBatch(asset_events=ROWS[:2]))
    signer.step()
    store.write(WriteBatch(asset_events=ROWS[2:]))
    store.close()


def test_the_ledger_vouches_for_events(tmp_path):
    make_key(tmp_path / "key.pem")
    signed(tmp_path / "twin.sqlite", tmp_path / "key.pem")
    found = audit_file(tmp_path / "twin.sqlite")
    assert found.wrong == []
    # The registration, the row of the twin and two events; a seal of each transaction.
    assert (found.vouched, found.waiting) == (4 + 2, 1 + 1)


@pytest.mark.parametrize(
    "forgery",
    [
        ("change", {"body": '{"n":7}'}),
        ("change", {"principal": "bob"}),
        ("change", {"number": 9}),
        ("delete", {}),
        ("insert", {}),
    ],
    ids=lambda one: f"{one[0]}-{'-'.join(one[1])}",
)
def test_an_event_that_was_forged_with_its_checksum_is_found(tmp_path, forgery):
    make_key(tmp_path / "key.pem")
    path = tmp_path / "twin.sqlite"
    signed(path, tmp_path / "key.pem")
    with contextlib.closing(sqlite3.connect(path)) as writer, writer:
        act, change = forgery
        row = ROWS[0]._replace(**change)
        if act != "insert":
            writer.execute("delete from asset_events where event = ?", (ROWS[0].event,))
        if act != "delete":
            row = row._replace(event="z") if act == "insert" else row
            names = ", ".join(ASSET_EVENTS.all_columns)
            writer.execute(
                f"insert into asset_events ({names}) values (?,?,?,?,?,?,?)",
                ASSET_EVENTS.sealed(row),
            )
    (wrong,) = audit_file(path).wrong
    assert "asset_events" in wrong

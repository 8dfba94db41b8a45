"""A database of version 10 under heads that were signed then, opened by this software.

`version_10.sql` was written by the software of that version and dumped by SQLite: two twins,
three boots, two heads, and rows behind the second.
"""

import contextlib
import json
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from slowtime_services.clock import HandClock
from slowtime_services.credentials import Signer
from slowtime_services.ledger import Head
from tests.twin_server.persist.tables.test_levels import cut_of, states_of
from twin_server.events.deliveries import AlarmAcknowledgement
from twin_server.history.states import LAYOUT, from_bytes
from twin_server.persist import EventRow, SqliteStore, WriteBatch, WrongStoreError, audit_file
from twin_server.persist.layout import APPLICATION, VERSION, build_levels
from twin_server.persist.tables.checksums import seal
from twin_server.persist.tables.ledger import ChainEnds, of_act
from twin_server.pipeline.ingestion.ledger_signer import LedgerSigner
from twin_server.settings import LedgerSettings

from . import forging

VERSION_10 = (Path(__file__).parents[1] / "version_10.sql").read_text()
KEY = Signer(Ed25519PrivateKey.from_private_bytes(bytes(32)))


@pytest.fixture
def old(tmp_path):
    """A database of version 10, and its second head."""
    path = tmp_path / "twin.sqlite"
    with contextlib.closing(sqlite3.connect(path)) as writer:
        writer.executescript(VERSION_10)
        writer.execute(f"pragma application_id = {APPLICATION}")
        writer.execute(f"pragma user_version = {256 * LAYOUT + 10}")
        bodies = writer.execute("select body from heads order by number").fetchall()
    return path, Head.of(json.loads(bodies[1][0])["head"])


def go_on(path, turn=0, **settings):
    """Start a server with the key, let readings and an event come, and end it."""
    with contextlib.closing(SqliteStore(path, verify=False)) as store:
        signer = LedgerSigner(
            store, HandClock(2 * 10**18), KEY, LedgerSettings(**settings), lambda *_: None
        )
        first = 30 + 10 * turn
        cut = cut_of(3, states_of(np.arange(first, first + 10)))
        cut.events = [EventRow(0, "lab", "beam", turn, None, False, '{"kind":"new"}')]
        store.write(cut)
        signer.sign(2 * 10**18 + turn)
        return signer.refusal


def checked(path, kept=None):
    return audit_file(path, public=KEY.public, kept=kept)


def test_an_old_database_is_converted_signed_and_covered_by_its_old_heads(old):
    path, kept = old
    assert [go_on(path, turn) for turn in range(2)] == ["", ""]
    with contextlib.closing(sqlite3.connect(path)) as reader:
        assert reader.execute("pragma user_version").fetchone() == (VERSION,)
    for head in (None, kept):
        found = checked(path, head)
        assert (found.wrong, found.heads) == ([], 4)
    assert (found.vouched, found.against.number) == (44, 2)
    assert [note.partition(":")[0] for note in found.notes] == ["lab.beam", "lab.mast"]
    assert all("by an upgrade of the software" in note for note in found.notes)


def _scale_states(path, first, last):
    """Multiply states by 0.1, and make checksums and buckets anew."""
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as writer:
        for key, state in writer.execute(
            "select id, state from features where id between ? and ?", (first, last)
        ).fetchall():
            one = from_bytes([state]).copy()
            one["stiffness_change"] *= 0.1
            forged = one.tobytes()
            writer.execute(
                "update features set state = ?, state_crc = ? where id = ?",
                (forged, seal(key, forged), key),
            )
        writer.execute("delete from levels")
        build_levels(writer)


def scale_states(path):
    _scale_states(path, 1 << 40, (1 << 40) + 7)


def scale_states_beside_a_late_reading(path):
    """The chain needs no key: a reading of an earlier boot is chained behind the last head."""
    with contextlib.closing(SqliteStore(path)) as store:
        store.write(cut_of(1, states_of(np.arange(24, 26))))
    scale_states(path)


def estimate_anew(path):
    """An entry says that states were estimated anew, and scaled ones follow."""
    scale_states(path)
    _chain(path, "e")


def delete_and_register_again(path):
    _chain(path, "d")


def _chain(path, kind):
    with contextlib.closing(SqliteStore(path, verify=False)) as store:
        with store._writing() as writer:
            ChainEnds().append(writer, {"lab.beam": [of_act(kind)]})
            store._ends.forget()
        store.renew_basis()


def _forged(act, name):
    def work(path):
        with contextlib.closing(SqliteStore(path)) as store:
            rows = {table: forging.rows_of(store, forging.BY_NAME[table]) for table in [name]}
        house = forging.House(path, None, None, rows, rows)
        forging.forge(house, act, forging.BY_NAME[name])

    work.__name__ = f"{act.__name__}_{name}"
    return work


FORGERIES = (
    scale_states, scale_states_beside_a_late_reading, estimate_anew, delete_and_register_again,
    *(
        _forged(act, name)
        for act in (forging.edit, forging.delete, forging.insert)
        for name in ("features", "acknowledgements")
    ),
)  # fmt: skip


@pytest.mark.parametrize("forge", FORGERIES, ids=lambda forge: forge.__name__)
def test_what_an_old_head_covers_cannot_be_forged_before_or_after_the_upgrade(old, forge):
    path, kept = old
    with pytest.raises(WrongStoreError, match="Start the twin server on it once"):
        checked(path, kept)
    forge(path)
    assert "not signed any more" in go_on(path)
    found = checked(path, kept)
    assert found.wrong
    assert found.last.number == 2


def test_an_operator_may_go_on_behind_an_old_head_and_audits_against_it_say_so(old):
    path, kept = old
    scale_states(path)
    assert "not signed any more" in go_on(path)
    assert go_on(path, 1, continue_after_head=2) == ""
    assert go_on(path, 2) == ""
    assert checked(path).wrong == []
    assert any("states are not those" in what for what in checked(path, kept).wrong)


def test_readings_that_come_late_after_the_upgrade_are_no_forgery(old):
    path, kept = old
    with contextlib.closing(SqliteStore(path)) as store:
        store.write(cut_of(1, states_of(np.arange(24, 26))))
        store.write(
            WriteBatch(
                acknowledgements=[AlarmAcknowledgement("e9", "lab.beam", 9, "ann", "ann", "")]
            )
        )
    assert checked(path, kept).wrong == []
    assert go_on(path) == ""
    assert checked(path, kept).wrong == []

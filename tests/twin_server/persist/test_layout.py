"""Databases of before, and databases that something has gnawed at."""

import random
import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest

from twin_server.history.states import LAYOUT, blank
from twin_server.persist import (
    DamagedStoreError,
    DetailRow,
    DiagnosisRow,
    EventRow,
    FeatureRow,
    RunRow,
    SqliteStore,
    TwinRow,
    WriteBatch,
    WrongStoreError,
)
from twin_server.persist.layout import APPLICATION

VERSION_3 = (Path(__file__).parent / "version_3.sql").read_text()
LACKED = {1: ("details", "diagnoses"), 2: ("diagnoses",), 3: ()}


def filled(path, count=300):
    """A store with rows in every table, some of them changed and some gone again."""
    store = SqliteStore(path)
    rng = np.random.default_rng(1)
    rows, details = [], []
    for sequence in range(count):
        state = blank(1)
        state["sequence"], state["slow_time"] = sequence, sequence / 2
        rows.append(
            FeatureRow(
                1, sequence, 10 * sequence, sequence / 2, rng.bytes(400), state.tobytes()
            )
        )
        details.append(DetailRow(1, sequence, rng.bytes(48), rng.bytes(60)))
    for first in range(0, count, 50):
        last = first + 49
        run = RunRow(1, "lab", "beam", "b1", "d", last + 1, last, 10 * last, last, False, "[]")
        store.write(
            WriteBatch(
                twins=[TwinRow("lab", "beam", '{"a":1}', f'{{"b":{last}}}')],
                runs=[run],
                features=rows[first : last + 1],
                details=details[first : last + 1],
                held=[(1, last + 5, b"held")],
                released=[(1, last - 45)] if first else [],
                events=[EventRow(0, "lab", "beam", last, None, True, '{"kind":"x"}')],
            )
        )
    number = store.add_diagnosis(DiagnosisRow(0, "lab.beam", 5, None, "queued", "{}"), 9)
    done = store.diagnoses()[0]._replace(state="done", report="{}")
    store.end_diagnosis(done, b"<p>" * 100, "model: 1")
    assert number == 1
    return store


def told(store):
    """All that a store answers."""
    history = store.history("lab.beam")
    newest = store.history("lab.beam", t_ns=(500, 2000), newest=True, limit=20)
    return (
        store.twins(), store.runs(), store.held(), store.events(), store.diagnoses(),
        store.diagnosis_page("lab.beam", 1), store.diagnosis_model("lab.beam", 1),
        store.digest("lab.beam"),
        store.count("lab.beam"), history.states.tobytes(), history.bodies, history.boots,
        newest.states.tobytes(), store.messages("lab.beam", (1, 40), 100),
    )  # fmt: skip


@pytest.mark.parametrize("version", [1, 2, 3])
def test_a_database_of_before_is_brought_up_to_date_with_all_that_is_in_it(tmp_path, version):
    path = tmp_path / "old.sqlite"
    state = blank(1).tobytes()
    old = sqlite3.connect(path, isolation_level=None)
    old.executescript(VERSION_3)
    old.execute("insert into twins values ('lab.beam', 1, 'lab', 'beam', '{}', '{}')")
    old.execute(
        "insert into runs values (1,'lab.beam','lab','beam','b1','d',2,1,5,1,0,'[]',0.5,1)"
    )
    for key, message in ((1 << 40, b"m"), ((1 << 40) + 1, b"n")):
        old.execute("insert into features values (?,5,0.5,?,?)", (key, message, state))
    for body in ("{}", "[]"):
        old.execute(
            "insert into events values (null,'lab.beam','lab','beam',5,null,1,?)", (body,)
        )
    old.execute("delete from events where number = 2")
    old.execute("insert into held values (1, 7, x'00')")
    if version > 1:
        old.execute("insert into details values (?, x'', x'7b7d')", (1 << 40,))
    for table in LACKED[version]:
        old.execute(f"drop table {table}")
    old.execute(f"pragma application_id = {APPLICATION}")
    old.execute(f"pragma user_version = {256 * LAYOUT + version}")
    old.close()
    for _ in range(2):
        store = SqliteStore(path)
        assert store.twins() == [TwinRow("lab", "beam", "{}", "{}")]
        assert [row.message for row in store.messages("lab.beam", (0, -1), 9)] == [b"m", b"n"]
        assert store.held() == [(1, 7, b"\x00")]
        assert store.history("lab.beam").bodies == ([b"{}", None] if version > 1 else ())
        assert [e.body for e in store.events()] == ["{}"]
        store.close()
    store = SqliteStore(path)
    new = [EventRow(0, "lab", "beam", 6, None, False, "{}")]
    assert store.write(WriteBatch(events=new)) == [3]
    assert store.add_diagnosis(DiagnosisRow(0, "lab.beam", 5, None, "queued", "{}"), 9) == 1
    store.close()


@pytest.mark.parametrize("seed", range(4))
def test_a_flipped_byte_gives_a_refusal_or_the_very_same_answers(tmp_path, seed):
    store = filled(tmp_path / "sound.sqlite")
    before = told(store)
    store.close()
    store = SqliteStore(tmp_path / "sound.sqlite")
    assert told(store) == before
    store.close()
    sound = (tmp_path / "sound.sqlite").read_bytes()
    rng = random.Random(seed)
    cures = []
    for _ in range(25):
        at, by = rng.randrange(len(sound)), rng.randrange(1, 256)
        damaged = bytearray(sound)
        damaged[at] ^= by
        path = tmp_path / "damaged.sqlite"
        path.write_bytes(damaged)
        for leftover in tmp_path.glob("damaged.sqlite-*"):
            leftover.unlink()
        try:
            again = SqliteStore(path)
        except WrongStoreError as error:
            cures.append(str(error))
            continue
        assert told(again) == before, f"byte {at} changed by {by:#x}"
        again.close()
    assert len(cures) > 10
    assert all("--database" in cure for cure in cures)


@pytest.mark.parametrize("what", ["state", "message", "slow_time"])
def test_what_rots_while_the_server_runs_is_noticed_where_it_is_read(tmp_path, what):
    store = filled(tmp_path / "x.sqlite", 50)
    other = sqlite3.connect(tmp_path / "x.sqlite", isolation_level=None)
    value = 7.5 if what == "slow_time" else b"\x00" * 300
    other.execute(f"update features set {what} = ? where id = ?", (value, (1 << 40) + 20))
    other.close()
    with pytest.raises(DamagedStoreError, match=r"damaged.*checksum.*slowtime db restore"):
        store.history("lab.beam") if what == "state" else store.messages("lab.beam", (1, 0), 50)
    store.close()
    with pytest.raises(DamagedStoreError, match="is not as it was written"):
        SqliteStore(tmp_path / "x.sqlite")


@pytest.mark.parametrize(
    "done",
    [
        "delete from tallies where what = 'events'",
        "drop trigger features_go; delete from features where id & 1023 = 7",
        "drop index runs_of_twin",
        "drop trigger held_come",
        "pragma writable_schema=1; update sqlite_master set sql = replace(sql, 'real', 'text')",
    ],
)
def test_rows_tables_and_indices_that_are_missing_or_other_are_noticed(tmp_path, done):
    filled(tmp_path / "x.sqlite", 50).close()
    other = sqlite3.connect(tmp_path / "x.sqlite", isolation_level=None)
    other.executescript(done)
    other.close()
    with pytest.raises(DamagedStoreError, match=r"damaged.*slowtime db restore"):
        SqliteStore(tmp_path / "x.sqlite")


def test_a_database_in_use_is_refused_and_one_held_by_a_stranger_too(tmp_path):
    path = tmp_path / "x.sqlite"
    store = SqliteStore(path)
    with pytest.raises(WrongStoreError, match=r"in use by another twin server. End that one"):
        SqliteStore(path)
    store.close()
    holder = sqlite3.connect(path, isolation_level=None)
    holder.execute("pragma journal_mode=delete")
    holder.execute("begin exclusive")
    with pytest.raises(WrongStoreError, match=r"locked.*end that one"):
        SqliteStore(path, lock_s=0.05)
    holder.execute("rollback")
    holder.close()
    SqliteStore(path).close()


def test_a_copy_of_the_pages_of_another_moment_is_noticed(tmp_path):
    """As where a disk forgets a write that it had confirmed."""
    path = tmp_path / "x.sqlite"
    filled(path, 100).close()
    old = path.read_bytes()
    shutil.copy(path, tmp_path / "y.sqlite")
    filled_more = SqliteStore(tmp_path / "y.sqlite")
    filled_more.write(
        WriteBatch(events=[EventRow(0, "lab", "beam", 1, None, True, "{}") for _ in range(200)])
    )
    filled_more.close()
    new = bytearray((tmp_path / "y.sqlite").read_bytes())
    changed = [
        at for at in range(0, len(old), 4096) if old[at : at + 4096] != new[at : at + 4096]
    ]
    noticed = 0
    for at in changed:
        torn = bytearray(new)
        torn[at : at + 4096] = old[at : at + 4096]
        (tmp_path / "torn.sqlite").write_bytes(torn)
        try:
            SqliteStore(tmp_path / "torn.sqlite").close()
        except WrongStoreError:
            noticed += 1
    assert noticed == len(changed) >= 3

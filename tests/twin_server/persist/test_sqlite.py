"""History on disk: what was written is read, whatever the question and the hour of death."""

import sqlite3
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from twin_server.history.states import blank
from twin_server.persist import (
    EventRow,
    FeatureRow,
    RunRow,
    SqliteStore,
    StateRow,
    StoreError,
    TwinRow,
    WriteBatch,
    WrongStoreError,
    open_store,
)
from twin_server.persist.sqlite import open_reader
from twin_server.persist.tables.twins import GROWTH


def run_row(number, *, last, asset="beam", closed=False):
    return RunRow(
        number, "lab", asset, f"b{number}", "d", last + 1, last, 0, last, closed, "[]"
    )


def feature_rows(number, entries):
    rows = []
    for sequence, t_ns, slow in entries:
        state = blank(1)
        state["sequence"], state["t_ns"], state["slow_time"] = sequence, t_ns, slow
        rows.append(
            FeatureRow(number, sequence, t_ns, slow, b"m%d" % sequence, state.tobytes())
        )
    return rows


def event_row(body="{}", *, derived=True, asset="beam"):
    return EventRow(0, "lab", asset, 5, None, derived, body)


def write(store, number, entries, **more):
    entries = list(entries)
    run = run_row(number, last=entries[-1][0], **more)
    store.write(WriteBatch(runs=[run], features=feature_rows(number, entries)))


def told(history):
    return [
        (n, int(s)) for n, s in zip(history.number, history.states["sequence"], strict=True)
    ]


def test_what_was_written_is_there_after_reopening(database):
    store = open_store(database("x"))
    cut = WriteBatch(
        twins=[TwinRow("lab", "beam", "{}", "{}")],
        runs=[run_row(1, last=2)],
        features=feature_rows(1, [(0, 10, 0.5), (1, 11, 1.5), (2, 12, 2.5)]),
        held=[(1, 5, b"later")],
        events=[event_row("one"), event_row("two")],
    )
    assert store.write(cut) == [1, 2]
    before = store.digest("lab.beam")
    store.close()
    again = open_store(database("x"))
    assert again.twins() == cut.twins
    assert again.runs() == (cut.runs, 2)
    assert again.held() == cut.held
    assert [e.body for e in again.events("lab.beam")] == ["one", "two"]
    assert again.digest("lab.beam") == before
    assert before[1] == again.count("lab.beam") == 3
    assert again.history("lab.beam").boots == {1: ("b1", "d")}
    again.close()


def grow(store, sequence, **changed):
    """Let boot 1 grow by one feature, as a pipeline does; return its account."""
    run = RunRow(1, "lab", "beam", "b1", "d", sequence + 1, sequence, sequence, -1, False, "[]")
    run = run._replace(**changed)
    rows = feature_rows(1, [(sequence, sequence, float(sequence))])
    store.write(WriteBatch(runs=[run], features=rows))
    return run


def written_next(store):
    """Next sequence by the row of the only boot."""
    with store._reading() as reader:
        return reader.execute("select next from runs").fetchone()[0]


def test_the_row_of_a_boot_that_only_grows_is_written_now_and_then(database):
    store = open_store(database("x"))
    store.write(WriteBatch(twins=[TwinRow("lab", "beam", "{}", "{}")]))
    for sequence in range(2 * GROWTH):
        run = grow(store, sequence)
        assert written_next(store) == sequence // GROWTH * GROWTH + 1
        assert store.runs() == ([run], 2)
    assert told(store.history("lab.beam", limit=1, newest=True)) == [(1, run.last)]
    before = store.digest("lab.beam")
    store.close()
    again = open_store(database("x"))
    assert again.runs() == ([run], 2)
    assert again.digest("lab.beam") == before
    assert grow(again, run.last + 1) == again.runs()[0][0]
    assert told(again.history("lab.beam", limit=1, newest=True)) == [(1, run.last + 1)]
    again.close()


@pytest.mark.parametrize(
    "changed", [{"lost": "[[2, 2]]"}, {"told": 9}, {"closed": True}, {"next": 6}]
)
def test_what_does_not_follow_from_features_is_written_at_once(database, changed):
    store = open_store(database("x"))
    for sequence in (0, 1):
        grow(store, sequence)
    assert written_next(store) == 1
    run = grow(store, 3, **changed)
    assert written_next(store) == run.next
    assert store.runs() == ([run], 2)
    store.close()


def test_a_slow_time_that_falls_is_noted_at_once(database):
    store = open_store(database("x"))
    for sequence, slow in enumerate((0.0, 2.0, 1.0)):
        run = RunRow(
            1, "lab", "beam", "b1", "d", sequence + 1, sequence, sequence, -1, False, "[]"
        )
        rows = feature_rows(1, [(sequence, sequence, slow)])
        store.write(WriteBatch(runs=[run], features=rows))
    assert written_next(store) == 3
    assert told(store.history("lab.beam", slow_time=(1.5, None))) == [(1, 1)]
    store.close()


def test_a_write_that_fails_leaves_the_account_of_before(database):
    store = open_store(database("x"))
    grow(store, 0)
    kept = grow(store, 1)
    with pytest.raises(StoreError):
        grow(store, 1)  # its id is there already
    assert store.runs() == ([kept], 2)
    assert grow(store, 2) == store.runs()[0][0]
    store.close()


runs = st.lists(
    st.lists(st.tuples(st.integers(1, 3), st.floats(-5, 5)), min_size=1, max_size=25),
    min_size=1,
    max_size=4,
)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    steps=runs,
    rising=st.booleans(),
    t=st.tuples(st.none() | st.integers(-5, 80), st.none() | st.integers(-5, 80)),
    slow=st.tuples(st.none() | st.floats(-20, 60), st.none() | st.floats(-20, 60)),
    limit=st.none() | st.integers(1, 10),
    newest=st.booleans(),
)
def test_any_question_is_answered_as_by_looking_at_every_row(
    store, steps, rising, t, slow, limit, newest
):
    store.delete("lab.beam")
    everything = []
    for number, entries in enumerate(steps, start=1):
        rows, t_ns, at = [], 0, 0.0
        for sequence, (step, drift) in enumerate(entries):
            t_ns, at = t_ns + step, at + (abs(drift) if rising else drift)
            rows.append((2 * sequence, t_ns, at))
        write(store, number, rows[: len(rows) // 2 + 1])
        if rows[len(rows) // 2 + 1 :]:
            write(store, number, rows[len(rows) // 2 + 1 :])
        everything += [(number, *row) for row in rows]
    wanted = [
        (number, sequence)
        for number, sequence, t_ns, at in everything
        if (t[0] is None or t_ns >= t[0])
        and (t[1] is None or t_ns <= t[1])
        and (slow[0] is None or at >= slow[0])
        and (slow[1] is None or at <= slow[1])
    ]
    if limit is not None:
        wanted = wanted[-limit:] if newest else wanted[:limit]
    found = store.history("lab.beam", t_ns=t, slow_time=slow, limit=limit, newest=newest)
    assert told(found) == wanted


def test_what_follows_a_place_is_found_across_boots(store):
    write(store, 1, [(0, 1, 0.0), (3, 2, 1.0)])
    write(store, 2, [(0, 1, 0.0), (1, 2, 1.0)])
    assert told(store.history("lab.beam", after=(1, 0))) == [(1, 3), (2, 0), (2, 1)]
    assert told(store.history("lab.beam", after=(1, 3), limit=1)) == [(2, 0)]
    assert [(r.number, r.sequence) for r in store.messages("lab.beam", (1, 0), 2)] == [
        (1, 3),
        (2, 0),
    ]
    assert store.messages("lab.beam", (0, -1), 10)[0].message == b"m0"


def test_the_digest_sees_every_byte_and_the_order_of_boots(database):
    def digest(name, *, message=b"m", value=0.5, first="b1"):
        store = open_store(database(name))
        state = blank(1)
        state["correlation"] = value
        run = run_row(1, last=0)._replace(boot=first)
        store.write(
            WriteBatch(
                runs=[run, run_row(2, last=0)],
                features=[
                    FeatureRow(1, 0, 1, 0.0, message, state.tobytes()),
                    FeatureRow(2, 0, 1, 0.0, b"x", state.tobytes()),
                ],
            )
        )
        store.close()
        again = open_store(database(name))
        try:
            return again.digest("lab.beam")[0]
        finally:
            again.close()

    same = digest("1")
    assert digest("2") == same
    changed = [digest("3", message=b"n"), digest("4", value=np.nextafter(0.5, 1)),
               digest("5", first="b3")]  # fmt: skip
    assert len({same, *changed}) == 4


def test_a_cut_that_fails_leaves_nothing_behind(store):
    write(store, 1, [(0, 1, 0.0)])
    doubled = WriteBatch(
        twins=[TwinRow("lab", "new", "{}", "{}")],
        runs=[run_row(1, last=1)],
        features=feature_rows(1, [(1, 2, 1.0), (0, 1, 0.0)]),
        events=[event_row()],
    )
    with pytest.raises(
        StoreError, match=r"(?is)cannot be written:.*unique.*Nothing of this batch"
    ):
        store.write(doubled)
    assert store.twin("lab.new") is None
    assert store.count("lab.beam") == 1
    assert store.events() == []
    assert store.runs()[0][0].next == 1


def test_readers_see_whole_cuts_while_one_writes(store):
    stop, odd = threading.Event(), []

    def read():
        while not stop.is_set():
            found = store.history("lab.beam")
            if len(found.states) % 10:
                odd.append(len(found.states))

    readers = [threading.Thread(target=read) for _ in range(2)]
    write(store, 1, [(i, i, float(i)) for i in range(10)])
    for reader in readers:
        reader.start()
    for batch in range(1, 60):
        write(store, 1, [(10 * batch + i, 10 * batch + i, 0.0) for i in range(10)])
    stop.set()
    for reader in readers:
        reader.join()
    assert not odd
    assert store.count("lab.beam") == 600


def test_threads_that_come_and_go_share_their_connections(tmp_path, monkeypatch):
    opened = []

    def opening(*given):
        opened.append(open_reader(*given))
        return opened[-1]

    monkeypatch.setattr("twin_server.persist.sqlite.open_reader", opening)
    store = SqliteStore(tmp_path / "x.sqlite")
    write(store, 1, [(0, 1, 0.0)])
    counted = []
    for _ in range(50):
        thread = threading.Thread(target=lambda: counted.append(store.count("lab.beam")))
        thread.start()
        thread.join()
    assert counted == [1] * 50
    assert len(opened) == 1
    with store._reading() as one, ThreadPoolExecutor(1) as pool:
        assert store.count("lab.beam") == 1  # within the snapshot of this thread
        assert pool.submit(store.count, "lab.beam").result() == 1
        assert one is opened[0]
    assert len(opened) == 2
    store.close()
    for reader in opened:
        with pytest.raises(sqlite3.ProgrammingError, match="closed"):
            reader.execute("select 1")
    with pytest.raises(StoreError, match="has been closed"):
        store.count("lab.beam")


def test_forgetting_one_twin_leaves_the_others_and_reuses_no_number(store):
    store.write(WriteBatch(twins=[TwinRow("lab", a, "{}", "{}") for a in ("beam", "arch")]))
    write(store, 1, [(0, 1, 0.0)], asset="arch")
    write(store, 2, [(0, 1, 0.0)])
    store.write(WriteBatch(events=[event_row(), event_row(asset="arch")], held=[(2, 9, b"h")]))
    assert store.delete("lab.beam")
    assert not store.delete("lab.beam")
    assert [t.id for t in store.twins()] == ["lab.arch"]
    assert store.count("lab.beam") == 0
    assert store.count("lab.arch") == 1
    assert store.held() == []
    assert [e.asset for e in store.events()] == ["arch"]
    assert store.runs()[1] == 3


def test_rewriting_replaces_states_and_derived_events_and_keeps_the_rest(store):
    write(store, 1, [(0, 1, 0.0), (1, 2, 1.0)])
    store.write(WriteBatch(events=[event_row("derived"), event_row("lost", derived=False)]))
    new = blank(1)
    new["correlation"] = 0.25
    store.rewrite(
        "lab.beam",
        [StateRow(1, s, new.tobytes()) for s in (0, 1)],
        lambda: (TwinRow("lab", "beam", "r", "c"), [event_row("anew")]),
    )
    assert store.history("lab.beam").states["correlation"].tolist() == [0.25, 0.25]
    assert [e.body for e in store.events()] == ["lost", "anew"]
    assert store.twin("lab.beam") == TwinRow("lab", "beam", "r", "c")
    assert store.messages("lab.beam", (0, -1), 9)[1].message == b"m1"


def test_the_newest_events_and_those_after_a_number(store):
    store.write(WriteBatch(events=[event_row(str(i)) for i in range(9)]))
    assert [e.body for e in store.events(limit=2, newest=True)] == ["7", "8"]
    assert [e.number for e in store.events("lab.beam", after=4, limit=2)] == [5, 6]
    assert store.events("lab.other") == []


def test_another_program_s_database_is_refused(tmp_path):
    path = tmp_path / "x.sqlite"
    connection = sqlite3.connect(path)
    connection.execute("create table theirs (x)")
    connection.close()
    with pytest.raises(WrongStoreError, match=r"another program's database\. Give another"):
        SqliteStore(path)


def test_a_database_of_another_version_is_refused(tmp_path):
    SqliteStore(tmp_path / "x.sqlite").close()
    connection = sqlite3.connect(tmp_path / "x.sqlite")
    connection.execute("pragma user_version = 9999")
    connection.close()
    with pytest.raises(WrongStoreError, match=r"version 9999; this software reads \d+"):
        SqliteStore(tmp_path / "x.sqlite")


def test_a_file_that_is_no_database_is_refused(tmp_path):
    (tmp_path / "x.sqlite").write_bytes(b"not a database at all, " * 100)
    with pytest.raises(WrongStoreError, match=r"no database of slowtime.*another --data"):
        SqliteStore(tmp_path / "x.sqlite")


def test_a_full_disk_is_said_to_be_one(tmp_path):
    store = SqliteStore(tmp_path / "x.sqlite")
    store._writer.execute("pragma max_page_count = 20")
    rows = feature_rows(1, [(i, i, 0.0) for i in range(2000)])
    with pytest.raises(StoreError, match=r"full.*Make room on the disk"):
        store.write(WriteBatch(runs=[run_row(1, last=1999)], features=rows))
    assert store.count("lab.beam") == 0
    store._writer.execute("pragma max_page_count = 100000")
    store.write(WriteBatch(runs=[run_row(1, last=1999)], features=rows))
    assert store.count("lab.beam") == 2000
    store.close()

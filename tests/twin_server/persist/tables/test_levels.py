"""Buckets of a history show what all its states show, and cost the same of a million."""

import sqlite3

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from twin_server.history.buckets import Buckets, thin
from twin_server.history.states import blank
from twin_server.persist import (
    DamagedStoreError,
    FeatureRow,
    RunRow,
    SqliteStore,
    StateRow,
    TwinRow,
    WriteBatch,
    WrongStoreError,
    open_store,
    verify_file,
)
from twin_server.persist.layout import LACKING, VERSION

TWIN = TwinRow("lab", "beam", "{}", "{}")
NAMES = ("frequency_hz", "damping_ratio", "stiffness_change", "mass_change")


def states_of(sequences, seed=0):
    """States of a beam that ages; some of them are no estimate."""
    rng = np.random.default_rng(seed)
    states = blank(len(sequences))
    states["sequence"], states["t_ns"] = sequences, np.asarray(sequences) * 10**9
    states["slow_time"] = sequences
    value = rng.standard_normal((len(sequences), 2))
    half = rng.uniform(0.1, 2.0, (len(sequences), 2))
    for place, name in enumerate(NAMES[:3:2]):
        one = value[:, place]
        states[name] = np.column_stack((one, half[:, 0], one - half[:, 0], one + half[:, 1]))
    gone = rng.random(len(sequences)) < 0.1
    states["stiffness_change"][gone] = np.nan
    states["reasons"][gone] = 1
    states["truth"][:, 2] = value[:, 1] / 2
    return states


def cut_of(number, states, asset="beam", name=None):
    last = int(states["sequence"][-1])
    run = RunRow(
        number, "lab", asset, name or f"b{number}", "d", last + 1, last, 0, last, False, "[]"
    )
    rows = [
        FeatureRow(number, int(s["sequence"]), int(s["t_ns"]), float(s["slow_time"]),
                   b"m%d" % s["sequence"], s.tobytes())
        for s in states
    ]  # fmt: skip
    return WriteBatch(runs=[run], features=rows)


def fill(store, number, states, at_once=97, **more):
    for first in range(0, len(states), at_once):
        store.write(cut_of(number, states[first : first + at_once], **more))


def held_against(found, states, keys, max_points):
    """Hold a thinned history against all its states."""
    history, bands = found
    shown = [n << 40 | s for n, s in zip(history.number, history.states["sequence"].tolist(),
                                         strict=True)]  # fmt: skip
    assert set(shown) <= set(keys)
    assert shown == sorted(set(shown))
    if bands is None:
        assert shown == keys
        return
    assert 0 < len(shown) <= max_points < len(keys)
    assert 0 < len(bands) <= max(1, max_points // 2)
    assert bands.head["count"].sum() == len(keys)
    assert bands.head["first"][0] == keys[0]
    assert bands.head["last"][-1] == keys[-1]
    assert (shown[0], shown[-1]) == (keys[0], keys[-1])
    row = 0
    for head, found in zip(bands.head, bands.quantities, strict=True):
        inside = slice(row, row + int(head["count"]))
        part = states[inside]
        row = inside.stop
        assert [head["first"], head["last"]] == [keys[inside][0], keys[inside][-1]]
        assert head["valid"] == (part["reasons"] == 0).sum()
        assert head["slow_time"].tolist() == part["slow_time"][[0, -1]].tolist()
        for place, name in enumerate(NAMES):
            known = part[name][~np.isnan(part[name][:, 0])]
            assert found["count"][place] == len(known)
            if len(known):
                assert found["sum"][place] == pytest.approx(known[:, 0].sum(), abs=1e-9)
                told = [found[key][place] for key in ("min", "max", "lo", "hi")]
                value, _, lo, hi = known.T
                assert told == [value.min(), value.max(), lo.min(), hi.max()]
        truth = part["truth"][:, 2]
        assert found["truth"][2].tolist() == [truth.min(), truth.max()]
    if max_points >= 18:
        for name in NAMES[:3:2]:
            whole, kept = states[name], history.states[name]
            assert np.nanmin(kept[:, 2]) == np.nanmin(whole[:, 2])
            assert np.nanmax(kept[:, 3]) == np.nanmax(whole[:, 3])
            assert np.nanmax(kept[:, 0]) == np.nanmax(whole[:, 0])


boots = st.lists(
    st.tuples(st.integers(1, 900), st.sampled_from([1, 1, 1, 2, 37])), min_size=1, max_size=3
)
ends = st.none() | st.integers(-10, 2_000)


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    boots=boots,
    at_once=st.integers(1, 400),
    max_points=st.integers(2, 60),
    time=st.tuples(ends, ends),
    slow=st.tuples(ends, ends),
)
@example(boots=[(2, 37)], at_once=2, max_points=2, time=(None, None), slow=(None, None))
def test_a_thinned_history_is_what_all_states_show(
    store, boots, at_once, max_points, time, slow
):
    store.delete("lab.beam")
    parts, keys = [], []
    for number, (count, step) in enumerate(boots, start=1):
        sequences = np.arange(count) * step + (number % 2) * 3
        states = states_of(sequences, seed=number)
        fill(store, number, states, at_once=max(at_once, count // 20))
        inside = np.ones(count, bool)
        for name, (low, high), by in (("t_ns", time, 10**9), ("slow_time", slow, 1)):
            inside &= low is None or states[name] >= (low or 0) * by
            inside &= high is None or states[name] <= (high or 0) * by
        parts.append(states[inside])
        keys += [number << 40 | s for s in sequences[inside].tolist()]
    t_ns = tuple(None if end is None else end * 10**9 for end in time)
    found = store.thinned("lab.beam", max_points, t_ns=t_ns, slow_time=slow)
    held_against(found, np.concatenate(parts), keys, max_points)


def test_a_history_that_was_estimated_anew_is_thinned_anew(store):
    before, after = states_of(np.arange(700)), states_of(np.arange(700), seed=9)
    store.write(WriteBatch(twins=[TWIN]))
    fill(store, 1, before)
    rows = [StateRow(1, int(s["sequence"]), s.tobytes()) for s in after]
    store.rewrite("lab.beam", iter(rows), lambda: (TWIN, []))
    keys = [1 << 40 | s for s in range(700)]
    held_against(store.thinned("lab.beam", 20), after, keys, 20)
    more = states_of(np.arange(700, 1100), seed=2)
    fill(store, 1, more)
    keys += [1 << 40 | s for s in range(700, 1100)]
    whole = np.concatenate([after, more])
    held_against(store.thinned("lab.beam", 20), whole, keys, 20)
    store.delete("lab.beam")
    with store._reading() as reader:
        for table in ("levels", "digests"):
            assert reader.execute(f"select count(*) from {table}").fetchone() == (0,)


def test_buckets_read_back_as_they_were_written():
    states = states_of(np.arange(50))
    changes = np.random.default_rng(0).standard_normal((50, 2, 3))
    bodies = [b'{"elements":{"a":{},"b":{}},"modes":[],"truth":{"b":%d,"c":1}}' % i
              for i in range(50)]  # fmt: skip
    wide = Buckets.of_states(range(50), states, changes, bodies)
    assert wide.quantities["truth"][7, 5].tolist() == [7.0, 7.0]
    assert np.isnan(wide.quantities["truth"][:, 4]).all()
    narrow = Buckets.of_states(range(50, 60), states_of(np.arange(10)))
    mixed = [*wide.to_bytes()[:3], *narrow.to_bytes(), *wide.to_bytes()[3:]]
    again = Buckets.from_bytes(mixed)
    assert again.quantities.shape == (60, 6)
    assert again.head["first"].tolist() == [*range(3), *range(50, 60), *range(3, 50)]
    assert again.quantities[13:, 4:].tobytes() == wide.quantities[3:, 4:].tobytes()


@pytest.mark.parametrize("max_points", [2, 7, 40, 300])
def test_of_few_states_the_same_are_picked_as_ever(store, max_points):
    states = states_of(np.arange(300))
    fill(store, 1, states)
    found = store.thinned("lab.beam", max_points).history.states["sequence"]
    if len(states) <= 4 * max_points:
        assert found.tolist() == states["sequence"][thin(states, max_points)].tolist()


def steps(path, ask):
    """How many steps SQLite's machine takes for a question: no clock is involved."""
    store = SqliteStore(path)
    ask(store)
    counted = [0]

    def count():
        counted[0] += 1

    for reader in store._idle:
        reader.set_progress_handler(count, 100)
    ask(store)
    store.close()
    return counted[0]


@pytest.mark.parametrize(
    "ask",
    [
        lambda store: store.thinned("lab.beam", 60),
        lambda store: store.thinned("lab.beam", 60, slow_time=(11, None)),
        lambda store: store.digest("lab.beam"),
        lambda store: store.history("lab.beam", limit=100, newest=True),
    ],
    ids=["thinned", "since", "digest", "newest"],
)
def test_what_is_asked_often_costs_the_same_of_a_long_history(tmp_path, ask):
    for name, count in (("short", 1_000), ("long", 20_000)):
        store = SqliteStore(tmp_path / f"{name}.sqlite")
        fill(store, 1, states_of(np.arange(count)), at_once=2_000)
        store.close()
    short, long = (steps(tmp_path / f"{name}.sqlite", ask) for name in ("short", "long"))
    assert long <= 3 * short + 10


def digest_of(store, twin_id="lab.beam"):
    """Read everything, as for the first time."""
    fresh = type(store._hashes)()
    kept, store._hashes = store._hashes, fresh
    try:
        return store.digest(twin_id)
    finally:
        store._hashes = kept


def test_the_hash_that_is_rolled_on_is_that_of_all_rows(store):
    store.write(WriteBatch(twins=[TWIN]))
    for first in range(0, 1_200, 300):
        fill(store, 1, states_of(np.arange(first, first + 300)))
        fill(store, 7, states_of(np.arange(first, first + 300)), asset="other")
        assert store.digest("lab.beam") == digest_of(store)
    assert store.digest("lab.beam")[1] == 1_200
    fill(store, 9, states_of(np.arange(40)))
    assert store.digest("lab.beam") == digest_of(store)
    # Rows of an earlier boot are put before those of a later one.
    fill(store, 1, states_of(np.arange(1_200, 1_900)))
    assert store.digest("lab.beam") == digest_of(store)
    fill(store, 9, states_of(np.arange(40, 700)))
    assert store.digest("lab.beam") == digest_of(store)
    rows = [StateRow(1, s, blank(1).tobytes()) for s in range(1_900)]
    before = store.digest("lab.beam")
    store.rewrite("lab.beam", iter(rows), lambda: (TWIN, []))
    assert store.digest("lab.beam") == digest_of(store) != before
    store.verify()
    assert store.digest("lab.beam") == digest_of(store)
    store.delete("lab.beam")
    assert store.digest("lab.beam")[1] == 0
    assert store.digest("lab.other") == digest_of(store, "lab.other")


def test_a_hash_survives_a_cut_that_fails(store):
    fill(store, 1, states_of(np.arange(20)))
    before = store.digest("lab.beam")
    cut = cut_of(1, states_of(np.arange(20, 30)))
    cut.features.append(cut.features[0])
    with pytest.raises(Exception, match="cannot be written"):
        store.write(cut)
    assert store.digest("lab.beam") == before == digest_of(store)
    fill(store, 1, states_of(np.arange(20, 40)))
    assert store.digest("lab.beam") == digest_of(store)


def test_rows_that_were_exchanged_with_their_checksums_are_noticed(tmp_path):
    """Each row is sound, and their number and sums are; the history is another one."""
    path = tmp_path / "x.sqlite"
    store = SqliteStore(path)
    fill(store, 1, states_of(np.arange(1_100)))
    fill(store, 2, states_of(np.arange(8)), asset="twin")
    store.close()
    verify_file(path)
    other = sqlite3.connect(path, isolation_level=None)
    # The boot is renamed, with a checksum that holds.
    from twin_server.persist.tables.checksums import RUNS

    (row,) = other.execute(f"select {','.join(RUNS.columns)} from runs where number = 1")
    changed = RUNS.sealed(tuple("b9" if value == "b1" else value for value in row))
    other.execute("update runs set boot = ?, crc = ? where number = 1", ("b9", changed[-1]))
    other.close()
    with pytest.raises(DamagedStoreError, match="not the one that was hashed"):
        verify_file(path)
    with pytest.raises(WrongStoreError, match="not the one that was hashed"):
        SqliteStore(path)


def test_a_bucket_that_rots_is_noticed_where_it_is_read(tmp_path):
    path = tmp_path / "x.sqlite"
    store = SqliteStore(path)
    fill(store, 1, states_of(np.arange(2_000)))
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("update levels set bucket = zeroblob(length(bucket)) where level = 1")
    other.close()
    with pytest.raises(DamagedStoreError, match=r"A bucket of level 1.*is damaged"):
        store.thinned("lab.beam", 120)
    store.close()


@pytest.mark.parametrize("version", LACKING)
def test_a_database_of_before_gets_the_tables_that_it_lacks(database, version):
    store = open_store(database("x"))
    states = states_of(np.arange(1_500))
    store.write(WriteBatch(twins=[TWIN]))
    fill(store, 1, states)
    expected, digest = store.thinned("lab.beam", 40), store.digest("lab.beam")
    with store._writing() as writer:
        sqlite = isinstance(store, SqliteStore)
        for table in (lacked.name for lacked in LACKING[version]):
            writer.execute(f"drop table {table}")
            if sqlite:
                writer.execute(f"delete from tallies where what = '{table}'")
        if not sqlite:
            writer.execute("update layouts set version = ?", (version,))
    store.close()
    if sqlite:
        with sqlite3.connect(database("x"), isolation_level=None) as file:
            file.execute(f"pragma user_version={version}")
        file.close()
    for first in (1_500, 1_600):
        again = open_store(database("x"))
        found = again.thinned("lab.beam", 40)
        assert found.bands is not None
        assert expected.bands is not None
        assert found.bands.to_bytes() == expected.bands.to_bytes()
        assert found.history.states.tobytes() == expected.history.states.tobytes()
        assert again.digest("lab.beam") == digest
        fill(again, 1, states_of(np.arange(first, first + 100)))
        digest = again.digest("lab.beam")
        expected = again.thinned("lab.beam", 40)
        assert again.deliveries() == []
        again.close()
    assert sorted(LACKING) == [VERSION - n for n in (10, 9, 8, 7, 6, 5, 4, 3, 2, 1)]

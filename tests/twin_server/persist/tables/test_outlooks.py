"""Past outlooks are kept in order, bounded in number, and go with what they were stated of."""

import contextlib

import pytest

from tests.twin_server.persist.tables.test_levels import TWIN, fill, states_of
from twin_server.persist import (
    DamagedStoreError,
    OutlookRow,
    SqliteStore,
    WriteBatch,
    audit_file,
    open_store,
)


def row(number, twin="lab.beam"):
    return OutlookRow(twin, 1 << 40 | number, float(number), f'{{"n":{number}}}')


def test_the_newest_are_kept_and_read_in_order(database):
    with contextlib.closing(open_store(database("x"))) as store:
        for number in (16, 18, 20, 22):
            store.add_outlook(row(number), 3)
        store.add_outlook(row(5, "lab.mast"), 3)
        assert store.outlooks("lab.beam") == [row(18), row(20), row(22)]
        assert store.outlooks("lab.beam", until=row(21).id) == [row(18), row(20)]
        assert store.outlooks("lab.beam", limit=1) == [row(22)]
        assert store.outlooks("lab.beam", until=3) == []
        assert store.outlooks("lab.mast") == [row(5, "lab.mast")]


def test_they_go_where_a_history_is_rewritten_or_deleted(database):
    with contextlib.closing(open_store(database("x"))) as store:
        store.write(WriteBatch(twins=[TWIN]))
        fill(store, 1, states_of(range(40)))
        store.add_outlook(row(16), 3)
        store.rewrite("lab.beam", [], lambda: (TWIN, []))
        assert store.outlooks("lab.beam") == []
        store.add_outlook(row(16), 3)
        assert store.delete("lab.beam")
        assert store.outlooks("lab.beam") == []


def test_one_that_was_altered_is_not_answered_and_its_chain_tells(tmp_path):
    path = tmp_path / "twin.sqlite"
    with contextlib.closing(open_store(str(path))) as store:
        store.write(WriteBatch(twins=[TWIN]))
        for number in (16, 18, 20):
            store.add_outlook(row(number), 2)
    assert audit_file(path).wrong == []
    with contextlib.closing(SqliteStore(path, verify=False)) as store:
        with store._writing() as writer:
            writer.execute("update outlooks set body = '{}' where slow_time = 20.0")
        with pytest.raises(DamagedStoreError, match="outlooks"):
            store.outlooks("lab.beam")
    assert any("outlooks" in wrong for wrong in audit_file(path).wrong)

"""Registrations of composites are kept in order, and none is ever lost."""

import sqlite3

import pytest

from twin_server.persist import CompositeRow, DamagedStoreError, open_store
from twin_server.persist.layout import LACKING, WITHOUT_COMPOSITES


def row(composite="lab.line", body="{}", t_ns=5):
    return CompositeRow(0, composite, t_ns, "somebody", body)


def test_what_was_registered_is_read_back_in_order_under_numbers_of_its_own(store):
    store.add_composites([row(), row("lab.site", '{"a":1}')])
    store.add_composites([])
    store.add_composites([row(body="", t_ns=9)])
    assert [one.number for one in store.composites()] == [1, 2, 3]
    assert store.composites("lab.line") == [
        row()._replace(number=1),
        row(body="", t_ns=9)._replace(number=3),
    ]
    assert store.composites("lab.none") == []


def test_a_file_of_the_version_before_gets_the_table_and_keeps_the_rest(tmp_path):
    path = tmp_path / "twin.sqlite"
    open_store(path).close()
    with sqlite3.connect(path, isolation_level=None) as file:
        for table in LACKING[WITHOUT_COMPOSITES]:
            file.execute(f"drop table {table.name}")
            file.execute("delete from tallies where what = ?", (table.name,))
        file.execute(f"pragma user_version={WITHOUT_COMPOSITES}")
    file.close()
    store = open_store(path)
    store.add_composites([row()])
    assert len(store.composites()) == 1
    store.close()
    open_store(path).close()


def test_a_row_that_was_changed_is_noticed(tmp_path):
    path = tmp_path / "twin.sqlite"
    store = open_store(path)
    store.add_composites([row()])
    store.close()
    with sqlite3.connect(path, isolation_level=None) as file:
        file.execute("update composites set principal = 'another'")
    file.close()
    with pytest.raises(Exception, match="composites") as told:
        open_store(path)
    assert isinstance(told.value, DamagedStoreError) or "not as it was written" in str(
        told.value
    )

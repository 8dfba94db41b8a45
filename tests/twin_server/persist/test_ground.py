"""Files of an open database that are moved, deleted, replaced or overwritten."""

import contextlib
import logging
import os
import shutil
import sqlite3
import tempfile
import threading
from pathlib import Path

import pytest

from twin_server.persist import (
    SqliteStore,
    StoreError,
    WriteBatch,
    WrongStoreError,
    backup,
    ground,
)
from twin_server.persist import sqlite as sqlite_module
from twin_server.persist.tables.rows import TwinRow

pytestmark = pytest.mark.skipif(os.name == "nt", reason="open files cannot be moved there")


NOBODY = 65_534
"""User and group without rights, by custom."""


def note(store, number):
    store.write(WriteBatch(twins=[TwinRow("lab", f"t{number}", "{}", "{}")]))


def names(store):
    return [row.id for row in store.twins()]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "data" / "twin.sqlite"


@pytest.fixture
def short_log(monkeypatch):
    """Bounds of the log small enough for a test."""
    monkeypatch.setattr(sqlite_module, "LOG_BYTES", 1 << 16)
    monkeypatch.setattr(sqlite_module, "LONGEST_LOG_BYTES", 1 << 20)


@pytest.fixture
def store(path):
    made = SqliteStore(path)
    note(made, 1)
    yield made
    made.close()


def reopened(path):
    with contextlib.closing(SqliteStore(path)) as store:
        return names(store)


def test_a_database_that_is_moved_away_takes_nothing_until_it_is_back(
    store, path, tmp_path, caplog
):
    path.rename(tmp_path / "elsewhere")
    for _ in range(3):
        with pytest.raises(StoreError, match=r"was moved away .* Move it back"):
            note(store, 2)
        with pytest.raises(StoreError, match="was moved away"):
            store.twins()
        with pytest.raises(StoreError, match="was moved away"):
            store.check()
    assert [record.levelno for record in caplog.records] == [logging.ERROR]  # said once
    (tmp_path / "elsewhere").rename(path)
    note(store, 3)
    assert names(store) == ["lab.t1", "lab.t3"]
    assert "The server goes on" in caplog.text
    store.close()
    assert reopened(path) == ["lab.t1", "lab.t3"]


def test_a_file_that_is_moved_away_holds_all_that_was_acknowledged(store, path, tmp_path):
    path.rename(tmp_path / "elsewhere")
    with pytest.raises(StoreError):
        note(store, 2)
    # As after SIGKILL: without the log, which is still at the old place.
    assert reopened(shutil.copy(tmp_path / "elsewhere", tmp_path / "alone")) == ["lab.t1"]


def test_a_folder_that_is_moved_away_takes_nothing_until_it_is_back(store, path, tmp_path):
    path.parent.rename(tmp_path / "elsewhere")
    with pytest.raises(StoreError, match="was moved away"):
        note(store, 2)
    (tmp_path / "elsewhere").rename(path.parent)
    note(store, 3)
    assert names(store) == ["lab.t1", "lab.t3"]


@pytest.fixture
def ordinary_folder():
    """A folder of an ordinary user, as whom the test goes on; root may write anywhere."""
    folder = Path(tempfile.mkdtemp(prefix="slowtime-ground-"))
    former = os.geteuid()
    if former == 0:
        os.chown(folder, NOBODY, NOBODY)
    yield folder
    os.seteuid(former)
    folder.chmod(0o755)
    shutil.rmtree(folder)


def test_a_folder_that_becomes_read_only_costs_nothing_and_is_said_at_the_next_start(
    ordinary_folder,
):
    path = ordinary_folder / "twin.sqlite"
    with contextlib.closing(SqliteStore(path)) as store:
        note(store, 1)
        if os.geteuid() == 0:
            for file in ordinary_folder.iterdir():
                os.chown(file, NOBODY, NOBODY)
            os.seteuid(NOBODY)
            if not os.access(sqlite_module.__file__, os.R_OK, effective_ids=True):
                pytest.skip("other users cannot read the folder that slowtime is installed in")
        ordinary_folder.chmod(0o555)
        note(store, 2)  # into files that are open
        assert names(store) == ["lab.t1", "lab.t2"]
        with pytest.raises(StoreError, match=r"attempt cannot be written: Permission denied"):
            store.attempts.write(b"a new file")
    for file in ordinary_folder.iterdir():
        file.chmod(0o444)
    with pytest.raises(WrongStoreError, match=r"cannot be written: Permission .* let this"):
        SqliteStore(path)
    ordinary_folder.chmod(0o755)
    for file in ordinary_folder.iterdir():
        file.chmod(0o644)
    assert reopened(path) == ["lab.t1", "lab.t2"]


def test_a_database_that_another_process_holds_is_read_meanwhile_and_goes_on(path, store):
    store.close()
    with (
        contextlib.closing(SqliteStore(path, lock_s=0.05)) as store,
        contextlib.closing(sqlite3.connect(path, isolation_level=None)) as holder,
    ):
        holder.execute("begin exclusive")
        with pytest.raises(StoreError, match=r"locked.* Another process holds it"):
            note(store, 2)
        assert names(store) == ["lab.t1"]
        holder.execute("rollback")
        note(store, 3)
        assert names(store) == ["lab.t1", "lab.t3"]


def test_another_database_in_its_place_takes_and_answers_nothing(store, path, tmp_path):
    other = tmp_path / "other.sqlite"
    with contextlib.closing(SqliteStore(other)) as made:
        note(made, 9)
    path.rename(tmp_path / "elsewhere")
    shutil.copy(other, path)
    with pytest.raises(StoreError, match="Another file was put at"):
        note(store, 2)
    with pytest.raises(StoreError, match="Another file was put at"):
        store.twins()
    (tmp_path / "elsewhere").replace(path)
    note(store, 3)
    assert names(store) == ["lab.t1", "lab.t3"]


@pytest.mark.parametrize("what", ["file", "folder"])
def test_of_a_deleted_database_a_copy_is_kept_with_all_that_was_acknowledged(
    store, path, what, caplog
):
    if what == "file":
        path.unlink()
    else:
        shutil.rmtree(path.parent)
    with pytest.raises(StoreError, match=r"was deleted .* rename the copy"):
        note(store, 2)
    store.close()
    rescued = path.with_name("twin.sqlite.rescued-1")
    assert f"All that was acknowledged is in {rescued}" in caplog.text
    for end in ("", "-wal", "-shm"):
        path.with_name(path.name + end).unlink(missing_ok=True)
    assert reopened(rescued.rename(path)) == ["lab.t1"]


def test_a_database_that_is_deleted_between_two_commits_is_kept_at_the_end(store, path):
    path.unlink()
    store.close()
    assert reopened(path.with_name("twin.sqlite.rescued-1")) == ["lab.t1"]


def test_a_copy_over_the_database_is_noticed_and_refused_for_good(store, path, tmp_path):
    backup(path, tmp_path / "monday.sqlite")
    note(store, 2)
    former = path.read_bytes()
    shutil.copyfile(tmp_path / "monday.sqlite", path)
    with pytest.raises(StoreError, match=r"Another program has written into .* End the server"):
        note(store, 3)
    path.write_bytes(former)
    with pytest.raises(StoreError, match="Another program has written into"):
        store.twins()


def test_a_log_that_is_cut_is_noticed(store, path):
    os.truncate(path.with_name(path.name + "-wal"), 0)
    with pytest.raises(StoreError, match="or cut its log"):
        note(store, 2)


@pytest.mark.parametrize("end", ["-wal", "-shm"])
def test_without_its_log_or_index_nothing_is_taken_and_nothing_acknowledged_is_missing(
    store, path, end
):
    path.with_name(path.name + end).unlink()
    with pytest.raises(StoreError, match=f"{end} was removed or replaced"):
        note(store, 2)
    with pytest.raises(StoreError, match="End the server and start it again"):
        store.twins()
    store.close()
    assert reopened(path) == ["lab.t1"]


def test_a_file_that_is_moved_during_the_commit_is_not_acknowledged(store, path, tmp_path):
    def move(statement):
        if statement.lower() == "commit":
            path.rename(tmp_path / "elsewhere")

    store._writer.set_trace_callback(move)
    with pytest.raises(StoreError, match="was moved away"):
        note(store, 2)
    store._writer.set_trace_callback(None)
    (tmp_path / "elsewhere").rename(path)
    note(store, 3)
    assert names(store) == ["lab.t1", "lab.t2", "lab.t3"]  # durable, and never acknowledged


def test_a_lock_that_is_removed_is_taken_again_and_keeps_a_second_server_off(
    store, path, caplog
):
    path.with_name(path.name + ".lock").unlink()
    note(store, 2)
    assert "is locked again" in caplog.text
    with pytest.raises(RuntimeError, match="in use by another twin server"):
        SqliteStore(path)


def test_a_second_server_that_took_the_lock_stops_the_first(store, path):
    lock = path.with_name(path.name + ".lock")
    lock.unlink()
    with ground.guarding(path), pytest.raises(StoreError, match="in use by another"):
        note(store, 2)
    note(store, 3)
    assert names(store) == ["lab.t1", "lab.t3"]


def test_a_reader_for_minutes_is_named_and_the_log_stays_within_its_bound(
    short_log, store, path, caplog
):
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as reader:
        reader.execute("begin")
        reader.execute("select count(*) from twins").fetchone()
        number = 2
        with contextlib.suppress(StoreError):
            while number < 1_000:
                note(store, number)
                number += 1
        assert number < 1_000
        log = path.with_name(path.name + "-wal")
        assert (1 << 20) <= log.stat().st_size < (1 << 20) + (1 << 17)
        assert "has grown to" in caplog.text
        with pytest.raises(StoreError, match="another process reads one moment"):
            store.check()
        assert len(names(store)) == number - 1
    note(store, number)
    note(store, number + 1)
    assert log.stat().st_size < 1 << 20
    assert len(names(store)) == number + 1


def test_the_log_is_copied_into_the_database_as_it_grows(short_log, store, path):
    for number in range(2, 100):
        note(store, number)
    assert path.with_name(path.name + "-wal").stat().st_size < 1 << 18
    assert len(names(store)) == 99


def test_readers_take_no_checkpoint_of_the_server_for_a_foreign_hand(store, monkeypatch):
    monkeypatch.setattr(sqlite_module, "LOG_BYTES", 1 << 16)  # a checkpoint each 20 commits
    ended, faults, reads = threading.Event(), [], []

    def read():
        while not ended.is_set():
            try:
                reads.append(len(store.twins()))
            except StoreError as error:
                faults.append(str(error))
                return

    readers = [threading.Thread(target=read) for _ in range(2)]
    for reader in readers:
        reader.start()
    try:
        for number in range(400):
            row = TwinRow("lab", f"t{number % 8}", "{}", f'"{number:09d}{"x" * 3_000}"')
            store.write(WriteBatch(twins=[row]))
    finally:
        ended.set()
        for reader in readers:
            reader.join()
    assert faults == []
    assert reads

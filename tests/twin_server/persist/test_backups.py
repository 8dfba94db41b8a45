"""Backups under load, and their way back."""

import contextlib
import errno
import os
import shutil
import sqlite3
import threading
from pathlib import Path

import pytest

from slowtime_cli.__main__ import main
from twin_server.persist import SqliteStore, WrongStoreError, backup, restore, verify_file
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings


def ran(*words):
    with pytest.raises(SystemExit) as ended:
        main([*map(str, words)])
    return ended.value.code


def test_a_backup_under_load_is_exactly_what_was_acknowledged_by_then(tmp_path, ageing, sample):
    samples = [sample(message) for message in ageing(1200)]
    store = SqliteStore(tmp_path / "twin.sqlite")
    pipeline = Pipeline(TwinSettings(pipeline={"batch_messages": 20}), store)
    begun = threading.Event()

    def work():
        pipeline.ingest(samples[:100])
        begun.set()
        pipeline.ingest(samples[100:])

    worker = threading.Thread(target=work)
    worker.start()
    begun.wait()
    acknowledged = []
    for number in range(3):
        before = store.count("lab.beam")
        backup(tmp_path / "twin.sqlite", tmp_path / f"{number}.sqlite")
        acknowledged.append((before, store.count("lab.beam")))
    worker.join()
    store.close()
    for number, (least, most) in enumerate(acknowledged):
        restored = tmp_path / "restored" / "twin.sqlite"
        restore(tmp_path / f"{number}.sqlite", restored)
        kept = SqliteStore(restored)
        count = kept.count("lab.beam")
        assert least <= count <= most
        quiet = SqliteStore(tmp_path / f"quiet-{number}.sqlite")
        Pipeline(TwinSettings(), quiet).ingest(samples[:count])
        assert kept.digest("lab.beam") == quiet.digest("lab.beam")
        assert kept.twins() == quiet.twins()
        Pipeline(TwinSettings(), kept).ingest(samples[count:])
        assert kept.count("lab.beam") == 1200
        kept.close()
        quiet.close()


def test_what_was_there_is_kept_aside_with_its_log(tmp_path):
    path = tmp_path / "twin.sqlite"
    store = SqliteStore(path)
    backup(path, tmp_path / "a.sqlite")
    with pytest.raises(WrongStoreError, match="in use by another twin server"):
        restore(tmp_path / "a.sqlite", path)
    shutil.copy(path, tmp_path / "busy.sqlite")
    shutil.copy(str(path) + "-wal", tmp_path / "busy.sqlite-wal")
    store.close()
    aside = restore(tmp_path / "a.sqlite", tmp_path / "busy.sqlite")
    assert aside == tmp_path / "busy.sqlite.aside-1"
    assert (tmp_path / "busy.sqlite.aside-1-wal").exists()
    assert not (tmp_path / "busy.sqlite-wal").exists()
    assert restore(tmp_path / "a.sqlite", tmp_path / "busy.sqlite") != aside


def _disk_full(*_names):
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("fails", ["copying", "syncing", "renaming"])
def test_a_backup_that_cannot_be_restored_leaves_the_database_in_place(
    tmp_path, monkeypatch, fails
):
    path = tmp_path / "twin.sqlite"
    SqliteStore(path).close()
    backup(path, tmp_path / "copy")
    path.with_name("twin.sqlite-wal").write_bytes(b"a log")
    before = {one.name: one.read_bytes() for one in tmp_path.iterdir()}
    if fails == "renaming":
        monkeypatch.setattr(Path, "rename", _disk_full)
    else:
        monkeypatch.setattr(*{"copying": (shutil, "copyfile"), "syncing": (os, "fsync")}[fails],
                            _disk_full)  # fmt: skip
    with pytest.raises(WrongStoreError, match="No space left on device"):
        restore(tmp_path / "copy", path)
    assert {one.name: one.read_bytes() for one in tmp_path.iterdir()} == before


def test_a_database_that_cannot_be_moved_back_is_named(tmp_path, monkeypatch):
    path = tmp_path / "twin.sqlite"
    SqliteStore(path).close()
    backup(path, tmp_path / "copy")
    before = path.read_bytes()
    replace = Path.replace
    monkeypatch.setattr(Path, "rename", _disk_full)
    monkeypatch.setattr(
        Path, "replace", lambda old, new: (replace if old == path else _disk_full)(old, new)
    )
    with pytest.raises(
        WrongStoreError, match=r"not be moved back from .*twin\.sqlite\.aside-1"
    ):
        restore(tmp_path / "copy", path)
    assert (tmp_path / "twin.sqlite.aside-1").read_bytes() == before


def test_a_damaged_database_gives_no_backup_and_a_damaged_backup_is_not_restored(tmp_path):
    path = tmp_path / "twin.sqlite"
    SqliteStore(path).close()
    damaged = bytearray(path.read_bytes())
    damaged[4096] ^= 0xFF  # what kind of page it is
    (tmp_path / "bad.sqlite").write_bytes(damaged)
    with pytest.raises(WrongStoreError):
        backup(tmp_path / "bad.sqlite", tmp_path / "b.sqlite")
    assert not (tmp_path / "b.sqlite").exists()
    before = path.read_bytes()
    with pytest.raises(WrongStoreError):
        restore(tmp_path / "bad.sqlite", path)
    assert path.read_bytes() == before
    assert not list(tmp_path.glob(".*"))


def test_an_empty_file_is_named_and_gives_no_backup(tmp_path):
    empty = tmp_path / "twin.sqlite"
    empty.touch()
    for work in (lambda: backup(empty, tmp_path / "b.sqlite"), lambda: verify_file(empty)):
        with pytest.raises(WrongStoreError, match=r"twin\.sqlite is empty. Give the database"):
            work()
    assert [path.name for path in tmp_path.iterdir()] == ["twin.sqlite"]


def test_a_database_of_another_program_is_named_and_not_its_copy(tmp_path):
    other = tmp_path / "notes.sqlite"
    with contextlib.closing(sqlite3.connect(other)) as connection:
        connection.execute("create table notes (text)")
    with pytest.raises(WrongStoreError, match=r"notes\.sqlite is not a database of this"):
        backup(other, tmp_path / "b.sqlite")


def test_the_verbs_say_in_a_sentence_what_they_found(tmp_path, capsys):
    path, copy = tmp_path / "twin.sqlite", tmp_path / "copy.sqlite"
    SqliteStore(path).close()
    assert ran("check", path) == 0
    assert "features: 0 rows" in capsys.readouterr().out
    assert ran("backup", path, "--out", copy) == 0
    assert ran("backup", path, "--out", copy) == 2
    assert "exists. Give a new file" in capsys.readouterr().err
    assert ran("restore", copy, "--database", path) == 0
    assert "The previous database was moved to" in capsys.readouterr().out
    path.write_bytes(b"no database of anybody " * 400)
    assert ran("check", path) == 2
    assert "restore the last backup with `slowtime db restore`" in capsys.readouterr().err
    verify_file(copy)

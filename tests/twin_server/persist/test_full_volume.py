"""A volume without room, or without inodes, while the server signs, backs up or migrates."""

import contextlib
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from slowtime_services.credentials import make_key
from twin_server.persist import (
    SqliteStore,
    StoreError,
    WrongStoreError,
    audit_file,
    backup,
    restore,
)
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings

from .test_killed import old_database
from .test_layout import filled, told

MIB = 1 << 20


@pytest.fixture
def volume(tmp_path):
    """Mount small volumes; skip where that is not allowed."""
    mounted: list[Path] = []

    def mount(size=4 * MIB, inodes=200):
        where = tmp_path / f"volume-{len(mounted)}"
        where.mkdir()
        options = f"size={size},nr_inodes={inodes}"
        command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(where)]
        if shutil.which("mount") is None or os.geteuid() != 0:
            pytest.skip("only root may mount a small volume")
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            pytest.skip(f"no volume can be mounted here: {done.stderr.strip()}")
        mounted.append(where)
        return where

    yield mount
    for where in mounted:
        subprocess.run(["umount", "--lazy", str(where)], check=True)


def fill(folder):
    """Take all room of a volume."""
    with contextlib.suppress(OSError), (folder / "ballast").open("wb", buffering=0) as ballast:
        while True:
            ballast.write(bytes(4096))


def take_inodes(folder):
    """Take all inodes of a volume."""
    with contextlib.suppress(OSError):
        for number in range(10_000):
            (folder / f"ballast-{number}").touch()


def make_room(folder):
    for path in folder.glob("ballast*"):
        path.unlink()


@pytest.mark.parametrize("full", [fill, take_inodes])
def test_a_ledger_goes_on_after_its_volume_was_full_and_proves_all_that_was_accepted(
    volume, tmp_path, ageing, sample, full
):
    where = volume(size=(3 if full is fill else 32) * MIB)
    public = make_key(tmp_path / "ledger.pem")
    settings = TwinSettings(ledger={"key": tmp_path / "ledger.pem", "every_s": 0.001})
    messages = [sample(message) for message in ageing(400)]
    with contextlib.closing(SqliteStore(where / "twin.sqlite")) as store:
        pipeline = Pipeline(settings, store)
        pipeline.ingest(messages[:50])
        signer = pipeline.ledger_signer
        assert signer is not None
        assert signer.sign(1) is not None
        full(where)
        accepted, refused = 50, []
        for message in messages[50:]:
            try:
                pipeline.ingest([message])
                signer.step()
            except StoreError as error:
                refused.append(str(error))
            assert store.count("lab.beam") >= accepted
            accepted = store.count("lab.beam")
        assert refused if full is fill else accepted == 400
        assert all("Make room on the disk" in said for said in refused)
        make_room(where)
        pipeline.ingest(messages)
        assert store.count("lab.beam") == 400
        signer.sign(2)
    found = audit_file(where / "twin.sqlite", public=public)
    assert not found.wrong
    assert found.waiting == 0
    SqliteStore(where / "twin.sqlite").close()


@pytest.mark.parametrize("full", [fill, take_inodes])
def test_a_backup_or_restore_on_a_full_volume_leaves_nothing_and_harms_nothing(
    volume, tmp_path, full
):
    where = volume(size=2 * MIB)
    with contextlib.closing(filled(tmp_path / "twin.sqlite", 200)) as store:
        expected = told(store)
    shutil.copy(tmp_path / "twin.sqlite", where / "other.sqlite")
    full(where)
    names = {*where.iterdir(), where / "other.sqlite.lock"}
    with pytest.raises(WrongStoreError, match=r"cannot be (copied|written)"):
        backup(tmp_path / "twin.sqlite", where / "monday.sqlite")
    with pytest.raises(WrongStoreError, match=r"cannot be (used|written)"):
        restore(tmp_path / "twin.sqlite", where / "other.sqlite")
    assert set(where.iterdir()) <= names
    make_room(where)
    with contextlib.closing(SqliteStore(where / "other.sqlite")) as store:
        assert told(store) == expected


@pytest.mark.parametrize("full", [fill, take_inodes])
def test_a_migration_on_a_full_volume_is_refused_and_done_once_there_is_room(volume, full):
    where = volume(size=2 * MIB)
    old_database(where)
    former = (where / "twin.sqlite").read_bytes()
    (where / "twin.sqlite.lock").touch()
    full(where)
    with pytest.raises(WrongStoreError, match="Make room on the disk"):
        SqliteStore(where / "twin.sqlite")
    assert len((where / "twin.sqlite").read_bytes()) == len(former)
    make_room(where)
    with contextlib.closing(SqliteStore(where / "twin.sqlite")) as store:
        assert len(store.messages("lab.beam", (0, -1), 99)) == 40

"""`slowtime db ledger` and `check --ledger` say in a sentence what somebody has rewritten."""

import json
import sqlite3
from pathlib import Path

import numpy as np
import pytest

from tests.twin_server.persist.test_ledger import change_message, store_at
from twin_server.persist import SqliteStore


@pytest.fixture
def signed(run):
    """A database under two heads, made by the key `ledger.pem`, in the folder of the test."""
    done = run("db", "ledger", "key", "ledger.pem")
    assert done.status == 0
    store_at("twin.sqlite", (Path("ledger.pem"), None), parts=2)
    return Path("twin.sqlite")


def test_a_database_that_nobody_touched_is_as_it_was_accepted(run, signed):
    done = run("db", "check", str(signed), "--ledger", "--key", "ledger.pem.pub")
    assert done.status == 0
    assert "as it was accepted: 52 ledger entries up to head 2; 0 since then" in done.out
    without = run("db", "check", str(signed), "--ledger").out
    assert "if the key in its heads is the server's (--key)" in without


def test_a_forged_row_is_named_with_its_twin(run, signed):
    writer = sqlite3.connect(signed, isolation_level=None)
    change_message(writer, np.random.default_rng(3))
    writer.close()
    done = run("db", "check", str(signed), "--ledger", "--key", "ledger.pem.pub")
    assert done.status != 0
    assert "lab.beam" in done.err


def test_a_head_that_was_kept_shows_a_cut_end(run, signed):
    store = SqliteStore(signed)
    newest = json.loads(store.heads(limit=1, newest=True)[0].body)["head"]
    store.close()
    Path("head.json").write_text(json.dumps(newest | {"number": 9}))
    done = run("db", "check", str(signed), "--ledger", "--head", "head.json")
    assert "head 9, which was kept elsewhere, is not in the ledger" in done.err
    assert "which ends at head 2" in done.err


def test_what_is_no_key_and_no_head_is_refused_with_what_to_give(refused, signed):
    assert ".pub" in refused("db", "check", str(signed), "--ledger", "--key", "nonsense")
    Path("head.json").write_text("{}")
    said = refused("db", "check", str(signed), "--ledger", "--head", "head.json")
    assert "slowtime db ledger head" in said
    assert "--ledger" in refused("db", "check", str(signed), "--key", "ledger.pem.pub")


@pytest.mark.usefixtures("signed")
def test_a_key_is_never_overwritten(refused):
    assert "exists" in refused("db", "ledger", "key", "ledger.pem")

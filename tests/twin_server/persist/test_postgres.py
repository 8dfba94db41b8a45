"""What is PostgreSQL's own: it goes away, comes back, is shared, and has a password."""

import contextlib
import os
import signal
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.postgres import schema_of, server
from twin_server.persist import (
    DamagedStoreError,
    EventRow,
    PostgresStore,
    StoreError,
    WriteBatch,
    WrongStoreError,
    database_answers,
    postgres,
)

EVENT = EventRow(0, "lab", "beam", 5, None, False, "{}")


@pytest.fixture
def url(postgres, request):
    """A schema of its own."""
    return schema_of(postgres, f"own_{abs(hash(request.node.name)) % 10**9}")


def test_a_database_that_goes_away_is_written_again_once_it_is_back(url, postgres):
    import psycopg

    store = PostgresStore(url)
    store.write(WriteBatch(events=[EVENT]))
    with psycopg.connect(postgres, autocommit=True) as other:
        other.execute(
            "select pg_terminate_backend(pid) from pg_stat_activity "
            "where pid <> pg_backend_pid() and backend_type = 'client backend'"
        )
    for _ in range(2):  # one connection writes, another one reads
        with contextlib.suppress(StoreError):
            store.write(WriteBatch(events=[EVENT]))
        with contextlib.suppress(StoreError):
            store.events()
    before = len(store.events())
    store.write(WriteBatch(events=[EVENT]))
    assert [e.number for e in store.events()] == list(range(1, before + 2))
    store.close()


def test_a_connection_that_stays_in_its_pipeline_is_replaced(url):
    store = PostgresStore(url)
    store.write(WriteBatch(events=[EVENT]))
    # So psycopg may leave it where the server is killed amid `executemany`.
    writer = store._open_writer().raw.pgconn
    writer.enter_pipeline_mode()
    writer.send_query_params(b"select 1", None)
    with contextlib.suppress(StoreError):
        store.write(WriteBatch(events=[EVENT]))
    before = len(store.events())
    for _ in range(3):
        store.write(WriteBatch(events=[EVENT]))
    assert len(store.events()) == before + 3
    store.close()


@pytest.mark.long
def test_a_second_server_on_one_schema_is_refused_until_the_first_has_ended(url):
    store = PostgresStore(url)
    with pytest.raises(WrongStoreError, match=r"in use by another twin server\. End that one"):
        PostgresStore(url)
    store.close()
    PostgresStore(url).close()


def test_a_server_that_starts_as_another_leaves_waits_for_it(url, monkeypatch):
    asked, store = threading.Event(), PostgresStore(url)
    monkeypatch.setattr(postgres, "time", Waiting(asked))
    with ThreadPoolExecutor(1) as server:
        starting = server.submit(PostgresStore, url)
        assert asked.wait(60)
        assert not starting.done()
        store.close()
        starting.result(60).close()


class Waiting:
    """A clock that stands, and says when somebody waits by it."""

    def __init__(self, asked):
        self.asked = asked

    def monotonic(self):
        return 0.0

    def sleep(self, seconds):
        self.asked.set()
        time.sleep(seconds)


def test_a_row_that_was_changed_behind_our_back_is_refused(url):
    import psycopg

    store = PostgresStore(url)
    store.write(WriteBatch(events=[EVENT]))
    with psycopg.connect(url, autocommit=True) as other:
        other.execute("update events set t_ns = 6")
    with pytest.raises(DamagedStoreError, match="checksum is wrong"):
        store.events()
    store.close()
    with pytest.raises(DamagedStoreError, match=r"row \d+ of events"):
        PostgresStore(url)


def test_no_password_is_said_where_nobody_answers():
    pytest.importorskip("psycopg", reason="no psycopg: pip install 'slowtime[postgres]'")
    with pytest.raises(WrongStoreError, match=r"(?s)cannot be reached.*PGPASSFILE") as said:
        PostgresStore("postgresql://twin:geheim@127.0.0.1:9/house")
    assert "geheim" not in str(said.value)


@pytest.fixture
def stopped(tmp_path):
    """A server of its own, and what stops all its processes and lets them go on."""
    with tempfile.TemporaryDirectory(prefix="slowtime-pg-") as name:
        folder = Path(name) / "pg"
        with server(folder) as url:

            def send(signal_number):
                first = int((folder / "data" / "postmaster.pid").read_text().split()[0])
                children = Path(f"/proc/{first}/task/{first}/children").read_text().split()
                for pid in (first, *map(int, children)):
                    os.kill(pid, signal_number)

            try:
                yield url, lambda: send(signal.SIGSTOP), lambda: send(signal.SIGCONT)
            finally:
                send(signal.SIGCONT)


@pytest.mark.long
def test_a_database_that_stands_still_is_waited_for_once_and_answers_when_it_goes_on(stopped):
    url, stop, go_on = stopped
    store = PostgresStore(url, answer_s=1.0)
    store.write(WriteBatch(events=[EVENT]))
    assert len(store.events()) == 1
    stop()
    begun = time.monotonic()
    with pytest.raises(StoreError):
        store.write(WriteBatch(events=[EVENT]))
    assert time.monotonic() - begun < 10.0
    begun = time.monotonic()
    for _ in range(50):
        with pytest.raises(StoreError, match="has not answered a statement in good time"):
            store.twins()
    assert time.monotonic() - begun < database_answers.AWAY_S
    go_on()
    time.sleep(database_answers.AWAY_S)
    before = len(store.events())  # the statement that was not answered may be durable
    store.write(WriteBatch(events=[EVENT]))
    assert len(store.events()) == before + 1
    store.close()


@pytest.mark.long
def test_readers_do_not_wait_for_a_writer_whose_database_stands_still(stopped):
    url, stop, _ = stopped
    store = PostgresStore(url, answer_s=5.0)
    with ThreadPoolExecutor(1) as pool:
        stop()
        writing = pool.submit(store.write, WriteBatch(events=[EVENT]))
        time.sleep(0.2)
        store._away.note("It stands still.")
        begun = time.monotonic()
        for reader in store._idle:
            reader.raw.close()
        with pytest.raises(StoreError, match="stands still"):
            store.twins()
        assert time.monotonic() - begun < 1.0
        with pytest.raises(StoreError):
            writing.result(60)
    store.close()

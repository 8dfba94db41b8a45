"""What a database says, by other code than the server's; what differs from a quiet life."""

import contextlib
import json
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import Sample
from slowtime_services.clock import HandClock
from slowtime_services.shards import Share
from twin_server.persist import SqliteStore, Store, is_url, open_store
from twin_server.persist.shares import database_of_share, postgres_share
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings

from .ledger import Key, Seen
from .schedule import ASSETS

LATER_NS = 4 * 10**18
"""Far in the future: the quiet life judges no clock a second time."""

_HISTORY = (
    "select asset, boot, id & ((cast(1 as bigint) << 40) - 1), message from features "
    "join runs on number = id >> 40"
)
_HOLD = "lock table features, runs, events in exclusive mode"
_END_WHO_WAIT = (
    "select pg_terminate_backend(pid) from pg_stat_activity "
    "where pg_backend_pid() = any(pg_blocking_pids(pid))"
)


def shares(count: int) -> list[Share | None]:
    """List the shares of the shards; a single server has none."""
    return [None] if count == 1 else [Share(index, count) for index in range(count)]


def databases(database: str, count: int) -> list[str]:
    """Name the database of each shard, or the one of a single server."""
    if count == 1:
        return [database]
    if is_url(database):
        return [postgres_share(database, Share(index, count)) for index in range(count)]
    path = Path(database)
    return [str(database_of_share(path, Share(index, count))) for index in range(count)]


def look(databases: Sequence[str]) -> Seen:
    """Read history and losses straight from the databases of all shards."""
    history: list[tuple[Key, bytes]] = []
    lost: list[tuple[str, str, int, int, str]] = []
    for database in databases:
        _look(database, history, lost)
    return Seen(history, lost)


def _look(
    database: str,
    history: list[tuple[Key, bytes]],
    lost: list[tuple[str, str, int, int, str]],
) -> None:
    with _asking(database) as ask:
        for asset, boot, sequence, message in ask(_HISTORY):
            history.append(((asset, boot, sequence), bytes(message)))
        for asset, body in ask("select asset, body from events"):
            event = json.loads(body)
            if event["kind"] == "features_lost":
                why = event["details"]
                lost.append((asset, why["boot"], why["first"], why["last"], why["why"]))


def rivals(databases: Sequence[str]) -> list[str]:
    """Tell of what the server takes for two agents of one asset; there are none."""
    told = []
    for database in databases:
        with _asking(database) as ask:
            told += [json.loads(body) for (body,) in ask("select body from events")]
    return [event["message"] for event in told if event["kind"] == "two_agents"]


def hold(database: str) -> Callable[[], None]:
    """Hold the database as an impolite backup or a curious person would; what ends it.

    PostgreSQL's administrator, who ends it, ends whoever waits for it as well.
    """
    if is_url(database):
        import psycopg

        person = psycopg.connect(database, autocommit=True, connect_timeout=5)
        try:
            person.execute("set lock_timeout = '2s'")
            person.execute("begin")
            person.execute(_HOLD)
        except psycopg.Error:
            person.close()
            return _nothing

        def away() -> None:
            with contextlib.suppress(psycopg.Error):
                person.execute(_END_WHO_WAIT)
            person.close()

        return away
    if not Path(database).exists():
        return _nothing
    holder = sqlite3.connect(
        database, isolation_level=None, check_same_thread=False, timeout=2.0
    )
    try:
        holder.execute("begin immediate")
    except sqlite3.OperationalError:
        holder.close()
        return _nothing

    def over() -> None:
        with contextlib.suppress(sqlite3.Error):
            holder.execute("rollback")
        holder.close()

    return over


def differences(database: str, count: int, quiet: Path) -> list[str]:
    """Give the same features to a server that nothing ever happens to; say what differs.

    That server is a single one, however many shards the other had.
    """
    found = []
    for share in shares(count):
        ours = [asset for asset in ASSETS if share is None or share.has(asset)]
        of_its_own = quiet.with_stem(f"{quiet.stem}-{share}")
        suffered, calm = open_store(database, share=share), SqliteStore(of_its_own)
        found += _differences(suffered, calm, ours)
    return found


def _differences(suffered: Store, calm: Store, assets: Sequence[str]) -> list[str]:
    try:
        pipeline = Pipeline(TwinSettings(), calm, clock=HandClock(LATER_NS))
        for asset in assets:
            rows = suffered.messages(f"lab.{asset}", (0, -1), 10**9)
            key = FEATURES.key("lab", asset)
            pipeline.ingest(Sample(key, row.message, None, True) for row in rows)
        pipeline.give_up()
        found = []
        for asset in assets:
            twin_id = f"lab.{asset}"
            for what, ours, theirs in (
                ("states", suffered.digest(twin_id), calm.digest(twin_id)),
                ("checkpoint", suffered.twin(twin_id), calm.twin(twin_id)),
                ("events", _derived(suffered, twin_id), _derived(calm, twin_id)),
            ):
                if ours != theirs:
                    found.append(f"{what} of {twin_id} differ from those of a quiet life")
        return found
    finally:
        suffered.close()
        calm.close()


@contextlib.contextmanager
def _asking(database: str) -> Iterator[Callable[[str], list[Any]]]:
    """Questions to a database that may not have been made yet, or be in other hands."""
    if is_url(database):
        import psycopg

        with psycopg.connect(database, autocommit=True, connect_timeout=5) as asked:
            there = asked.execute("select to_regclass('events')").fetchone()
            if there is None or there[0] is None:
                yield lambda _: []
            else:
                yield lambda question: asked.execute(question.encode()).fetchall()
        return
    try:
        reader = sqlite3.connect(f"file:{database}?mode=ro", uri=True, timeout=5.0)
    except sqlite3.OperationalError:
        yield lambda _: []
        return
    with contextlib.closing(reader):

        def ask(question: str) -> list[Any]:
            try:
                return reader.execute(question).fetchall()
            except sqlite3.OperationalError:
                return []

        yield ask


def _derived(store: Store, twin_id: str) -> list[str]:
    return [event.body for event in store.events(twin_id, limit=10**6) if event.derived]


def _nothing() -> None:
    pass

"""The memory of the twin in a PostgreSQL database: the same tables, questions and checksums.

Commits wait for the disk as the server is set up (``synchronous_commit``, on by default). The
driver, psycopg, is an extra of the package and is imported only where a URL asks for it.
"""

import contextlib
import math
import re
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from slowtime_services.ledger import Head

from .attempts import RowNote
from .database_answers import AWAY_S, Away, ConnectionDeadlines
from .errors import DamagedStoreError, StoreError, StoreInUseError, WrongStoreError
from .layout import (
    LACKING,
    VERSION,
    WITH_CURRENT_RUNS,
    all_rows,
    build_levels,
    chain_rows,
    postgres_lacking,
    postgres_schema,
)
from .ledger_audit import Audit, audit
from .sql import SqlStore
from .tables.checksums import FEATURES, LEDGER, LEVELS, TABLES
from .tables.digests import HistoryHasher
from .tables.ledger import build_ledger

GUARD = 0x736C6F77
"""Advisory lock of whoever writes."""
CONNECT_S = 10
"""How long a connection may take to be made [s]."""
ANSWER_S = 30.0
"""How long the answer to one statement may take [s]. The longest read at once is a history of
some million states, which takes a few seconds; a stopped server never answers."""
LEAVING_S = 5.0
"""How long the database may take to notice that the server before this one has left."""


class _Connection:
    """A psycopg connection with the interface of sqlite3.

    Parameters
    ----------
    answer_s
        How long the answer to a statement may take until the connection is ended [s].
    """

    def __init__(self, raw: Any, deadlines: ConnectionDeadlines, answer_s: float) -> None:
        self.raw, self._deadlines, self.answer_s = raw, deadlines, answer_s

    def execute(self, question: str, parameters: Sequence[Any] = (), /) -> Any:
        """Ask, and give a cursor over the answer."""
        cursor = self.raw.cursor(binary=True)
        with self._deadlines.within(self.answer_s, self.raw.fileno()):
            return cursor.execute(question.replace("?", "%s"), tuple(parameters))

    def executemany(self, question: str, parameters: Iterable[Sequence[Any]], /) -> Any:
        """Do the same with each of some parameters."""
        cursor = self.raw.cursor(binary=True)
        with self._deadlines.within(self.answer_s, self.raw.fileno()):
            cursor.executemany(question.replace("?", "%s"), [tuple(row) for row in parameters])
        return cursor


class PostgresStore(SqlStore):
    """One schema of a PostgreSQL database.

    Parameters
    ----------
    url
        ``postgresql://user@host/database``; what it leaves out, such as the password, comes
        from libpq's environment (PGPASSFILE, PGPASSWORD).
    verify
        Whether to look through all of it before anything is answered from it.
    answer_s
        How long the answer to a statement may take until the database counts as away [s].

    Raises
    ------
    WrongStoreError
        If it cannot be reached, is of another version, in use or damaged.
    """

    def __init__(self, url: str, *, verify: bool = True, answer_s: float = ANSWER_S) -> None:
        super().__init__()
        self._answer_s = answer_s
        self._url, self.name = url, without_secret(url)
        self._psycopg = driver()
        self._lock = threading.RLock()
        # Of its own: whoever reads does not wait for whoever writes.
        self._idle_lock = threading.Lock()
        self._away = Away()
        self._deadlines = ConnectionDeadlines(self._away, self.name)
        self._local = threading.local()
        self._idle: list[_Connection] = []
        self._closed = False
        self._writer: _Connection | None = None
        self._in_transaction = False
        self.attempts = RowNote(self._writing)
        try:
            self._prepare(self._open_writer())
            if verify:
                self.verify()
        except StoreError as error:
            self.close()
            if isinstance(error, WrongStoreError):
                raise
            raise WrongStoreError(str(error)) from error
        except BaseException:
            self.close()
            raise

    def verify(self, tell: Callable[[str, int], None] | None = None) -> None:
        """Verify all rows; raise where one is damaged.

        Rows that vanished are the business of PostgreSQL's page checksums: switch them on when
        the cluster is made (``initdb --data-checksums``).
        """
        with self._reading() as reader:
            reader.answer_s = math.inf  # of a large table the answer takes minutes
            roller = HistoryHasher(reader)
            for table in TABLES:
                rows = 0
                for row in all_rows(reader, table):
                    rows += 1
                    if not table.is_sound(row):
                        raise self._damaged(f"row {row[0]!r:.40} of {table.name}")
                    if table is FEATURES:
                        roller.take(row[0], row[3], row[4])
                if tell is not None:
                    tell(table.name, rows)
            reader.answer_s = self._answer_s
        if roller.wrong:
            raise self._damaged(roller.wrong[0])
        self._hashes.adopt(roller.found)

    def close(self) -> None:
        """Leave; readers in other threads must have ended."""
        with self._lock:
            with self._idle_lock:
                self._closed = True
                for connection in (*self._idle, *filter(None, [self._writer])):
                    connection.raw.close()
                self._idle.clear()
            self._writer = None
        self._deadlines.close()

    def _prepare(self, writer: _Connection) -> None:
        if writer.execute("select to_regclass('numbers')").fetchone()[0] is None:
            with writer.raw.transaction():
                writer.raw.execute(postgres_schema())
                writer.execute("insert into layouts values (?)", (VERSION,))
            return
        version = writer.execute("select max(version) from layouts").fetchone()[0]
        if version in LACKING:
            with writer.raw.transaction():
                writer.raw.execute(postgres_lacking(version))
                if LEVELS in LACKING[version]:
                    build_levels(writer)
                if LEDGER in LACKING[version]:
                    build_ledger(writer)
                if version < WITH_CURRENT_RUNS:
                    chain_rows(writer)
                writer.execute("insert into layouts values (?)", (VERSION,))
            return
        if version != VERSION:
            raise WrongStoreError(
                f"{self.name} is of version {version}; this software reads {VERSION}. Give "
                "another --database; what was recorded can be replayed into it."
            )

    def _connect(self) -> _Connection:
        if self._closed:
            raise StoreError(f"{self.name} has been closed.")
        self._away.check()
        begun_s = time.monotonic()
        try:
            raw = self._psycopg.connect(self._url, autocommit=True, connect_timeout=CONNECT_S)
        except self._psycopg.Error as error:
            said = str(error).replace(self._url, self.name).strip()
            text = (
                f"{self.name} cannot be reached: {said}. Start the database, or correct "
                "--database, PGPASSFILE and the like."
            )
            if time.monotonic() - begun_s > AWAY_S:  # a refusal costs next to nothing
                self._away.note(text)
            raise StoreError(text) from error
        self._away.clear()
        return _Connection(raw, self._deadlines, self._answer_s)

    def _open_writer(self) -> _Connection:
        """Return the one connection that writes; after a restart of the database a new one."""
        if self._writer is not None and not _at_rest(self._writer):
            self._writer.raw.close()
            self._writer = None
        if self._writer is None:
            writer = self._connect()
            question = "select pg_try_advisory_lock(?, hashtext(current_schema()))"
            until = time.monotonic() + LEAVING_S
            while not (mine := writer.execute(question, (GUARD,)).fetchone()[0]):
                if time.monotonic() > until:
                    break
                time.sleep(0.05)
            if not mine:
                writer.raw.close()
                raise StoreInUseError(
                    f"{self.name} is in use by another twin server. End that one, or give this "
                    "one another --database."
                )
            self._writer = writer
        return self._writer

    @contextlib.contextmanager
    def _writing(self) -> Iterator[_Connection]:
        """Hold the writer in a transaction; within another one, a part of that."""
        with self._lock:
            if self._in_transaction and self._writer is not None:
                yield self._writer
                return
            writer = self._open_writer()
            self._in_transaction = True
            try:
                with self._transaction(writer):
                    yield writer
            except self._psycopg.Error as error:
                raise StoreError(
                    f"{self.name} cannot be written: {error}. Nothing of this batch is kept. "
                    "Look at the database's own log and the room on its disk."
                ) from error
            finally:
                self._in_transaction = False
                if not _at_rest(writer):
                    writer.raw.close()
                    self._writer = None

    @contextlib.contextmanager
    def _transaction(self, writer: _Connection) -> Iterator[None]:
        writer.execute("begin")
        try:
            yield
            writer.execute("commit")
        except BaseException:
            with contextlib.suppress(self._psycopg.Error):
                writer.execute("rollback")
            raise

    @contextlib.contextmanager
    def _reading(self) -> Iterator[_Connection]:
        """Hold a connection of this thread that sees one snapshot of the database."""
        reader: _Connection | None = getattr(self._local, "reader", None)
        if reader is not None:
            yield reader
            return
        reader = self._take()
        try:
            reader.execute("begin isolation level repeatable read read only")
            self._local.reader = reader
            try:
                yield reader
            finally:
                self._local.reader = None
                with contextlib.suppress(self._psycopg.Error):
                    reader.execute("rollback")
        except self._psycopg.Error as error:
            if isinstance(error, self._psycopg.errors.DataCorrupted):
                raise self._damaged(str(error)) from error
            raise StoreError(
                f"{self.name} cannot be read: {error}. Look at the database's own log."
            ) from error
        finally:
            self._give(reader)

    def _take(self) -> _Connection:
        self._away.check()
        with self._idle_lock:
            while self._idle:
                reader = self._idle.pop()
                if not reader.raw.closed:
                    return reader
        return self._connect()

    def _give(self, reader: _Connection) -> None:
        with self._idle_lock:
            if self._closed or not _at_rest(reader):
                reader.raw.close()
            else:
                self._idle.append(reader)

    def _damaged(self, what: str) -> DamagedStoreError:
        return DamagedStoreError(
            f"{self.name} is damaged: {what}. Nothing is answered from it. Restore the last "
            "backup into another schema or database. Edges send again what they still hold; "
            "what they do not is reported as lost."
        )


def audit_url(url: str, *, public: str | None = None, kept: Head | None = None) -> Audit:
    """Compare a database that a server may be writing with its ledger.

    Raises
    ------
    WrongStoreError
        If it cannot be read, or is no database of this version.
    """
    psycopg, name = driver(), without_secret(url)
    try:
        with contextlib.closing(
            psycopg.connect(url, autocommit=True, connect_timeout=10)
        ) as raw:
            # Of a large table the answer takes minutes.
            reader = _Connection(raw, ConnectionDeadlines(Away(), name), math.inf)
            reader.execute("begin isolation level repeatable read read only")
            version = reader.execute("select max(version) from layouts").fetchone()[0]
            if version != VERSION:
                raise WrongStoreError(
                    f"{name} is not a database of this version of slowtime. Start the twin "
                    "server on it once, which brings an older one up to date."
                )
            return audit(reader, public=public, kept=kept)
    except psycopg.Error as error:
        said = str(error).replace(url, name).strip()
        raise WrongStoreError(
            f"{name} cannot be read: {said}. Start the database, or correct the URL, "
            "PGPASSFILE and the like."
        ) from error


def _at_rest(connection: _Connection) -> bool:
    """Whether a connection can be used again.

    Where the server is killed in the midst of `executemany`, libpq neither closes the
    connection nor leaves its pipeline mode, and every later statement fails.
    """
    pq, at = driver().pq, connection.raw.info
    return bool(
        at.status == pq.ConnStatus.OK
        and at.transaction_status == pq.TransactionStatus.IDLE
        and at.pipeline_status == pq.PipelineStatus.OFF
    )


def without_secret(url: str) -> str:
    """Return a URL without its password.

    Examples
    --------
    >>> without_secret("postgresql://twin:pa%40ss@db.example/house?password=x")
    'postgresql://twin:***@db.example/house?password=***'
    """
    shown = re.sub(r"(//[^:/@]*):[^@]*@", r"\1:***@", url)
    return re.sub(r"(password=)[^&]*", r"\1***", shown)


def driver() -> Any:
    """Import psycopg.

    Raises
    ------
    WrongStoreError
        If it is not installed; the text says how to.
    """
    try:
        import psycopg
    except ImportError as error:
        raise WrongStoreError(
            "A PostgreSQL database needs its driver: pip install 'slowtime[postgres]'. Or give "
            "a file as --database."
        ) from error
    return psycopg

"""The memory of the twin in one SQLite file: write-ahead log, one writer, any readers.

With ``synchronous=FULL`` each commit waits for the disk, so that what was acknowledged survives
a failing power supply; with ``NORMAL`` it survives the death of the process only.
"""

import contextlib
import logging
import os
import sqlite3
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal

from slowtime_services.ledger import Head
from slowtime_services.operating_system import same_file

from .attempts import FileNote, note_of
from .errors import DamagedStoreError, StoreError, WrongStoreError
from .ground import Fault, Ground, GroundKind, lock_of, rescue, take_lock
from .layout import APPLICATION, VERSION, bring_up_to_date, damages, schema
from .ledger_audit import Audit, audit
from .sql import SqlStore

logger = logging.getLogger(__name__)

LOCK_S = 10.0
"""How long another process may hold the database until that is said."""

LOG_BYTES = 16 << 20
"""Size of the write-ahead log from which it is copied into the database after a commit [bytes];
SQLite's own default is 4 MB, at which a busy server would do so ten times a second."""

LONGEST_LOG_BYTES = 4 << 30
"""Size of the write-ahead log at which nothing more is written [bytes]. It grows as long as
another process reads one moment of the database; edge agents keep what is not taken."""


class SqliteStore(SqlStore):
    """One database file.

    Parameters
    ----------
    path
        Where it is, or shall be; its folder is made if it is not there.
    synchronous
        ``"NORMAL"`` or ``"FULL"``, see above.
    verify
        Whether to look through all of it before anything is answered from it.
    lock_s
        How long to wait for another process that holds the database.

    Raises
    ------
    WrongStoreError
        If the file is another program's, of another version, in use or damaged.
    """

    def __init__(
        self,
        path: Path,
        *,
        synchronous: Literal["NORMAL", "FULL"] = "FULL",
        verify: bool = True,
        lock_s: float = LOCK_S,
    ) -> None:
        super().__init__()
        self.path = Path(path)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._attempts = FileNote(note_of(self.path))
        self._lock = threading.RLock()
        # Of its own: whoever reads does not wait for whoever writes.
        self._idle_lock = threading.Lock()
        self._local = threading.local()
        self._idle: list[sqlite3.Connection] = []
        self._closed = False
        self._lock_s = lock_s
        self._ground: Ground | None = None
        self._fault: Fault | None = None
        self._rescuer: threading.Thread | None = None
        self._told_log_bytes = LOG_BYTES
        self._guard = take_lock(self.path)
        try:
            with _explain_file_errors(self.path):
                self._writer = sqlite3.connect(
                    self.path, isolation_level=None, check_same_thread=False, timeout=lock_s
                )
                self._writer.execute("pragma journal_mode=wal")
                self._writer.execute(f"pragma synchronous={synchronous}")
                self._prepare()
                # From here on by `_checkpoint`, so that no other change looks like one.
                self._writer.execute("pragma wal_autocheckpoint=0")
                # Else the log keeps its greatest size, which says nothing of what is in it.
                self._writer.execute(f"pragma journal_size_limit={LOG_BYTES // 2}")
                self._writer.executescript("begin immediate; rollback;")  # opens the log
                self._ground = Ground(self.path)
                if verify:
                    self.verify()
        except BaseException:
            self.close()
            raise

    def verify(self, tell: Callable[[str, int], None] | None = None) -> None:
        """Verify the whole file; raise where anything is damaged.

        Parameters
        ----------
        tell
            Told the name of each table and how many rows it has.
        """
        with self._reading() as reader:
            found, hashes = damages(reader, tell)
        if found:
            raise _damaged(self.path, "; ".join(found[:5]))
        self._hashes.adopt(hashes)

    @property
    def attempts(self) -> FileNote:
        """Note of what the server is about to do."""
        return self._attempts

    def close(self) -> None:
        """Leave; readers in other threads must have ended."""
        with self._lock:
            with self._idle_lock:
                self._closed = True
                for reader in self._idle:
                    reader.close()
                self._idle.clear()
            if self._ground is not None:
                self._secure(self._ground)
            if self._rescuer is not None:
                self._rescuer.join()
            if hasattr(self, "_writer"):
                self._writer.close()
            if self._ground is not None:
                self._ground.close()
                self._ground = None
            self._attempts.close()
            if self._guard is not None:
                os.close(self._guard)
                self._guard = None

    def _prepare(self) -> None:
        application, version = (
            self._writer.execute(f"pragma {name}").fetchone()[0]
            for name in ("application_id", "user_version")
        )
        if (application, version) == (APPLICATION, VERSION):
            return
        if application == APPLICATION and bring_up_to_date(self._writer, version):
            return
        if self._writer.execute("select count(*) from sqlite_master").fetchone()[0]:
            raise WrongStoreError(
                f"{self.path} is "
                + (
                    f"a database of version {version}; this software reads {VERSION}. "
                    if application == APPLICATION
                    else "another program's database. "
                )
                + "Give another --database; what was recorded can be replayed into it."
            )
        self._writer.executescript(
            f"begin;{schema()}pragma application_id={APPLICATION};"
            f"pragma user_version={VERSION};commit;"
        )

    @contextlib.contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        """Hold the writer in a transaction; within another one, a part of that."""
        with self._lock:
            if self._closed:
                raise StoreError(f"{self.path} has been closed.")
            if self._writer.in_transaction and self._rescuer is None:
                yield self._writer
                return
            self._stand(writing=True)
            self._keep_guard()
            try:
                with self._transaction():
                    yield self._writer
            except sqlite3.Error as error:
                if _is_damage(error):
                    raise _damaged(self.path, str(error)) from error
                raise StoreError(
                    f"{self.path} cannot be written: {error}. Nothing of this batch is kept. "
                    + _cure(error)
                ) from error

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        if self._ground is not None and self._ground.log_bytes >= LONGEST_LOG_BYTES:
            if not self._copy_log(self._ground):
                raise StoreError(self._text_of_long_log(self._ground.log_bytes))
        self._writer.execute("begin immediate")
        try:
            yield
            self._stand()
            with contextlib.nullcontext() if self._ground is None else self._ground.changing():
                self._writer.execute("commit")
        except BaseException:
            # A full disk may have ended the transaction already.
            with contextlib.suppress(sqlite3.OperationalError):
                self._writer.execute("rollback")
            raise
        self._stand()  # again: a file that was moved meanwhile is not acknowledged
        if self._ground is not None:
            self._keep_log_short(self._ground)

    def _stand(self, *, writing: bool = False) -> None:
        """Raise where the files are not those that were opened.

        Parameters
        ----------
        writing
            Hold the writer outside a transaction: what was acknowledged is saved then.
        """
        if self._ground is None:
            return
        fault, before = self._ground.fault(), self._fault
        self._fault = fault
        if fault is None:
            if before is not None:
                logger.warning("%s is in its place again. The server goes on.", self.path)
            return
        if before is None or before.kind is not fault.kind:
            logger.error("%s", fault.text)
        if writing:
            self._secure(self._ground)
        raise StoreError(fault.text)

    def _keep_guard(self) -> None:
        """Lock the file again whose deletion would let a second server in."""
        assert self._guard is not None
        if same_file(self._guard, lock_of(self.path)):
            return
        try:
            guard = take_lock(self.path)
        except WrongStoreError as error:
            raise StoreError(str(error)) from error
        logger.warning("%s was removed or replaced, and is locked again.", lock_of(self.path))
        os.close(self._guard)
        self._guard = guard

    def _secure(self, ground: Ground) -> None:
        """Save what was acknowledged from a log or a file that no next start will find."""
        fault = ground.fault()
        if fault is None or self._rescuer is not None or fault.kind is GroundKind.OVERWRITTEN:
            return
        self._copy_log(ground)  # into the file that was opened, wherever it is now
        if fault.kind is GroundKind.DELETED:
            self._rescuer = threading.Thread(
                target=rescue, args=(self._writer, self.path), name="rescue"
            )
            self._rescuer.start()

    def _copy_log(self, ground: Ground) -> bool:
        """Copy the log into the database; return whether no reader needs what is there."""
        try:
            # Waits for no reader; what was committed is durable in the log in any case.
            with ground.changing():
                found = self._writer.execute("pragma wal_checkpoint(passive)").fetchone()
        except sqlite3.Error:
            return False
        _, pages, copied = found
        return bool(pages == copied)

    def _keep_log_short(self, ground: Ground) -> None:
        """Copy a long log into the database after a commit, and say where a reader holds it."""
        size = ground.log_bytes
        if size < LOG_BYTES or self._copy_log(ground):
            self._told_log_bytes = LOG_BYTES
        elif size >= 2 * self._told_log_bytes:
            self._told_log_bytes = size
            logger.warning("%s", self._text_of_long_log(size))

    def _text_of_long_log(self, size: int) -> str:
        return (
            f"{self.path}-wal has grown to {size >> 20} MB, because another process reads one "
            "moment of the database. End that one, such as a copy tool or an open SQL shell. "
            f"From {LONGEST_LOG_BYTES >> 20} MB on nothing more is taken, and edge agents keep "
            "what they send."
        )

    @contextlib.contextmanager
    def _reading(self) -> Iterator[sqlite3.Connection]:
        """Hold a connection of this thread that sees one snapshot of the database."""
        reader: sqlite3.Connection | None = getattr(self._local, "reader", None)
        if reader is not None:
            yield reader
            return
        self._stand()
        reader = self._take()
        try:
            reader.execute("begin")
            self._local.reader = reader
            try:
                yield reader
            finally:
                self._local.reader = None
                with contextlib.suppress(sqlite3.OperationalError):
                    reader.execute("rollback")
        except sqlite3.Error as error:
            if _is_damage(error):
                raise _damaged(self.path, str(error)) from error
            raise StoreError(f"{self.path} cannot be read: {error}. {_cure(error)}") from error
        finally:
            self._give(reader)

    def _take(self) -> sqlite3.Connection:
        """Take an idle reader, or open one: threads end, and their readers serve others."""
        with self._idle_lock:
            if self._closed:
                raise StoreError(f"{self.path} has been closed.")
            if self._idle:
                return self._idle.pop()
        return open_reader(self.path, self._lock_s)

    def _give(self, reader: sqlite3.Connection) -> None:
        with self._idle_lock:
            if self._closed or reader.in_transaction:
                reader.close()
            else:
                self._idle.append(reader)


def open_reader(path: Path, lock_s: float = LOCK_S) -> sqlite3.Connection:
    """Open a database for reading only, beside whoever writes it."""
    return sqlite3.connect(
        f"{path.absolute().as_uri()}?mode=ro",
        uri=True,
        isolation_level=None,
        check_same_thread=False,
        timeout=lock_s,
    )


def verify_file(
    path: Path, tell: Callable[[str, int], None] | None = None, *, source: Path | None = None
) -> None:
    """Verify a database that a server may be writing.

    Parameters
    ----------
    source
        Database of which `path` is a copy; messages name it.

    Raises
    ------
    WrongStoreError
        If anything is damaged, or it is no database of this version.
    """
    name = source or path
    if path.stat().st_size == 0:
        raise WrongStoreError(f"{name} is empty. Give the database of a twin server.")
    with _explain_file_errors(path), contextlib.closing(open_reader(path)) as reader:
        _check_version(reader, name)
        reader.execute("begin")
        found, _ = damages(reader, tell)
    if found:
        raise _damaged(name, "; ".join(found[:5]))


def audit_file(
    path: Path,
    *,
    public: str | None = None,
    kept: Head | None = None,
    tell: Callable[[str, int], None] | None = None,
) -> Audit:
    """Compare a sound database with its ledger (see `ledger_audit.audit`)."""
    with _explain_file_errors(path), contextlib.closing(open_reader(path)) as reader:
        _check_version(reader, path)
        reader.execute("begin")
        return audit(reader, public=public, kept=kept, tell=tell)


def _check_version(reader: sqlite3.Connection, name: Path) -> None:
    found = tuple(
        reader.execute(f"pragma {what}").fetchone()[0]
        for what in ("application_id", "user_version")
    )
    if found != (APPLICATION, VERSION):
        raise WrongStoreError(
            f"{name} is not a database of this version of slowtime. Start the twin server "
            "on it once, which brings an older one up to date."
        )


@contextlib.contextmanager
def _explain_file_errors(path: Path) -> Iterator[None]:
    """Describe the fault of a file, and what to do."""
    try:
        yield
    except UnicodeDecodeError as error:  # of a message that quotes the file
        raise _damaged(path, "it holds bytes that are no text") from error
    except sqlite3.Error as error:
        if _is_damage(error):
            raise _damaged(path, str(error)) from error
        raise WrongStoreError(
            f"{path} cannot be used as a database: {error}. {_cure(error)}"
        ) from error


def _damaged(path: Path, what: str) -> DamagedStoreError:
    return DamagedStoreError(
        f"{path} is damaged, or no database of slowtime: {what}. Nothing is answered from it. "
        "Keep it aside and restore the last backup with `slowtime db restore`. Give another "
        "--database to begin anew. Edges send again what they still hold; what they do not is "
        "reported as lost."
    )


def _is_damage(error: sqlite3.Error) -> bool:
    code = getattr(error, "sqlite_errorcode", None) or 0
    return code & 0xFF in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB) or (
        "Could not decode" in str(error) or "malformed" in str(error)
    )


def _cure(error: sqlite3.Error) -> str:
    if "locked" in str(error):
        return "Another process holds it: end that one, such as a copy tool or an open shell."
    return "Make room on the disk, or give another --database."

"""The memory of the twin in one SQLite file: write-ahead log, one writer, any readers.

With ``synchronous=NORMAL`` whatever was committed survives the death of the process; ``FULL``
waits for the disk at each commit, so that it survives a failing power supply too.
"""

import contextlib
import hashlib
import importlib.resources
import itertools
import sqlite3
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

from twin_server.states import LAYOUT, from_bytes

from . import diagnosing
from .detailing import changes, column, delete_details, has_details, insert_details
from .diagnosing import DiagnosisRow
from .searching import SHIFT, Span, spans_by_slow_time, spans_by_time, whole
from .store import (
    Cut,
    DetailRow,
    EventRow,
    FeatureRow,
    History,
    Pick,
    RunRow,
    StateRow,
    StoreError,
    TwinRow,
    WrongStoreError,
)

APPLICATION = 0x536C6F77
VERSION = 256 * LAYOUT + 3
"""Layout of the states, and of the tables around them."""

_DETAILS = (
    "create table details (id integer primary key, changes blob not null, body blob not null);"
)
_ADDED = {256 * LAYOUT + 1: _DETAILS + diagnosing.TABLE, 256 * LAYOUT + 2: diagnosing.TABLE}
"""What older versions lack; it is added where such a database is opened."""

_TWIN = "site, asset, registration, checkpoint"
_RUN = "number, site, asset, boot, slow_time_unit, next, last, last_t_ns, told, closed, lost"
_EVENT = "number, site, asset, t_ns, slow_time, derived, body"


class SqliteStore:
    """One database file.

    Parameters
    ----------
    path
        Where it is, or shall be; its folder is made if it is not there.
    synchronous
        ``"NORMAL"`` or ``"FULL"``, see above.

    Raises
    ------
    WrongStoreError
        If the file is another program's, of another version, or damaged.
    """

    def __init__(
        self, path: Path, *, synchronous: Literal["NORMAL", "FULL"] = "NORMAL"
    ) -> None:
        self.path = Path(path)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._lock = threading.RLock()
        self._local = threading.local()
        self._readers: list[sqlite3.Connection] = []
        self._closed = False
        try:
            self._writer = sqlite3.connect(
                self.path, isolation_level=None, check_same_thread=False, timeout=10.0
            )
            self._writer.execute("pragma journal_mode=wal")
            self._writer.execute(f"pragma synchronous={synchronous}")
            self._writer.execute("pragma wal_autocheckpoint=4000")
            self._prepare()
        except sqlite3.DatabaseError as error:
            raise WrongStoreError(
                f"{self.path} cannot be used as a database: {error}. Give another --database, "
                "or restore this one from a copy."
            ) from error

    def twins(self) -> list[TwinRow]:
        """All twins, in the order of their registration."""
        return [TwinRow(*r) for r in self._ask(f"select {_TWIN} from twins order by place")]

    def twin(self, twin_id: str) -> TwinRow | None:
        """One twin."""
        rows = self._ask(f"select {_TWIN} from twins where id = ?", (twin_id,))
        return TwinRow(*rows[0]) if rows else None

    def runs(self) -> tuple[list[RunRow], int]:
        """All boots in order, and the number the next one gets."""
        with self._reading() as reader:
            rows = reader.execute(f"select {_RUN} from runs order by number").fetchall()
            kept = reader.execute("select value from numbers where what = 'run'").fetchone()
        runs = [RunRow(*row)._replace(closed=bool(row[9])) for row in rows]
        return runs, max(kept[0] if kept else 1, runs[-1].number + 1 if runs else 1)

    def held(self) -> list[tuple[int, int, bytes]]:
        """Boot number, sequence and bytes of all features kept until their turn."""
        return self._ask("select number, sequence, message from held order by number, sequence")

    def write(self, cut: Cut) -> list[int]:
        """Make `cut` durable; give the numbers of its events."""
        with self._writing() as writer:
            if cut.twins:
                places = itertools.count(_following_place(writer))
                writer.executemany(
                    "insert into twins (id, place, site, asset, registration, checkpoint) "
                    "values (?, ?, ?, ?, ?, ?) "
                    "on conflict (id) do update set registration = excluded.registration, "
                    "checkpoint = excluded.checkpoint",
                    [(twin.id, next(places), *twin) for twin in cut.twins],
                )
            if cut.runs:
                writer.executemany(
                    f"insert into runs ({_RUN}, twin) values (?,?,?,?,?,?,?,?,?,?,?,?) "
                    "on conflict (number) do update set slow_time_unit = "
                    "excluded.slow_time_unit, next = excluded.next, last = excluded.last, "
                    "last_t_ns = excluded.last_t_ns, told = excluded.told, "
                    "closed = excluded.closed, lost = excluded.lost",
                    [(*run, f"{run.site}.{run.asset}") for run in cut.runs],
                )
            if cut.features:
                writer.executemany(
                    "insert into features values (?,?,?,?,?)",
                    [(n << SHIFT | s, *rest) for n, s, *rest in cut.features],
                )
                self._note_slow_times(writer, cut.features)
            if cut.details:
                insert_details(writer, cut.details)
            if cut.held:
                writer.executemany("insert or ignore into held values (?,?,?)", cut.held)
            if cut.released:
                writer.executemany(
                    "delete from held where number = ? and sequence = ?", cut.released
                )
            return [_insert_event(writer, event) for event in cut.events]

    def messages(self, twin_id: str, after: tuple[int, int], limit: int) -> list[FeatureRow]:
        """Read the next features of a twin, in order, after (boot number, sequence)."""
        floor = (after[0] << SHIFT) + after[1] + 1
        rows: list[Any] = []
        with self._reading() as reader:
            for span in whole(reader, twin_id):
                if span.last < floor or len(rows) == limit:
                    continue
                rows += reader.execute(
                    "select id, t_ns, slow_time, message, state from features "
                    "where id between ? and ? order by id limit ?",
                    (max(span.first, floor), span.last, limit - len(rows)),
                ).fetchall()
        return [FeatureRow(key >> SHIFT, key & _LOW, *rest) for key, *rest in rows]

    def rewrite(
        self,
        twin_id: str,
        states: Iterable[StateRow],
        finish: Callable[[], tuple[TwinRow, Sequence[EventRow]]],
    ) -> None:
        """Replace a twin's states, its registration and its derived events, all at once."""
        with self._writing() as writer:
            delete_details(writer, twin_id)
            rows = iter(states)
            while part := list(itertools.islice(rows, _AT_ONCE)):
                writer.executemany(
                    "update features set state = ? where id = ?",
                    [(row.state, row.number << SHIFT | row.sequence) for row in part],
                )
                insert_details(
                    writer,
                    [DetailRow(r.number, r.sequence, *r.detail) for r in part if r.detail],
                )
            twin, events = finish()
            writer.execute("delete from events where twin = ? and derived", (twin_id,))
            self.write(Cut(twins=[twin], events=list(events)))

    def delete(self, twin_id: str) -> bool:
        """Forget a twin and all it has seen; False where there is none."""
        with self._writing() as writer:
            following = self.runs()[1]
            delete_details(writer, twin_id)
            for span in whole(writer, twin_id):
                writer.execute(
                    "delete from features where id between ? and ?", (span.first, span.last)
                )
                writer.execute("delete from held where number = ?", (span.number,))
            for table in ("runs", "events", "diagnoses"):
                writer.execute(f"delete from {table} where twin = ?", (twin_id,))
            writer.execute("insert or replace into numbers values ('run', ?)", (following,))
            return writer.execute("delete from twins where id = ?", (twin_id,)).rowcount > 0

    def history(
        self,
        twin_id: str,
        *,
        t_ns: tuple[int | None, int | None] = (None, None),
        slow_time: tuple[float | None, float | None] = (None, None),
        after: tuple[int, int] | None = None,
        limit: int | None = None,
        newest: bool = False,
        pick: Pick | None = None,
    ) -> History:
        """States between two times, both included, or after (boot number, sequence)."""
        with self._reading() as reader:
            spans = whole(reader, twin_id)
            boots = {span.number: (span.boot, span.unit) for span in spans}
            spans = spans_by_time(reader, spans, *t_ns)
            spans = spans_by_slow_time(reader, spans, *slow_time)
            if after is not None:
                spans = [span.after(after[0] << SHIFT | after[1]) for span in spans]
            rows = _states(reader, spans, slow_time, limit, newest)
            states = from_bytes(state for _, state in rows)
            keys = [key for key, _ in rows]
            detailed = has_details(reader, keys)
            if pick is not None and keys:
                kept = pick(states, changes(reader, keys) if detailed else None)
                states, keys = states[kept], [keys[i] for i in kept.tolist()]
            bodies = column(reader, keys, "body") if detailed else ()
        return History(states, [key >> SHIFT for key in keys], boots, bodies)

    def count(self, twin_id: str) -> int:
        """How many features a twin has."""
        with self._reading() as reader:
            return sum(
                int(
                    reader.execute(
                        "select count(*) from features where id between ? and ?",
                        (span.first, span.last),
                    ).fetchone()[0]
                )
                for span in whole(reader, twin_id)
            )

    def digest(self, twin_id: str) -> tuple[str, int]:
        """SHA-256 over all features of a twin, their states and details, and their number."""
        digest, count = hashlib.sha256(), 0
        with self._reading() as reader:
            for span in whole(reader, twin_id):
                for key, message, state, body in reader.execute(
                    "select features.id, message, state, body from features "
                    "left join details on details.id = features.id "
                    "where features.id between ? and ? order by features.id",
                    (span.first, span.last),
                ):
                    head = f"{span.boot} {key & _LOW} {len(message)} {len(state)}\n"
                    digest.update(head.encode() + message + state + (body or b""))
                    count += 1
        return digest.hexdigest(), count

    def events(
        self,
        twin_id: str | None = None,
        *,
        after: int = 0,
        limit: int = 1000,
        newest: bool = False,
    ) -> list[EventRow]:
        """Events in order, of one twin or of all."""
        whose, parameters = ("twin = ? and", (twin_id,)) if twin_id else ("", ())
        rows = self._ask(
            f"select {_EVENT} from events where {whose} number > ? "
            f"order by number {'desc' if newest else 'asc'} limit ?",
            (*parameters, after, limit),
        )
        found = [EventRow(*row)._replace(derived=bool(row[5])) for row in rows]
        return found[::-1] if newest else found

    def add_diagnosis(self, row: DiagnosisRow, kept: int) -> int:
        """Keep a diagnosis that was asked for, and the last `kept` of its twin; its number."""
        with self._writing() as writer:
            number = diagnosing.insert(writer, row)
            diagnosing.forget(writer, row.twin, kept)
            return number

    def end_diagnosis(self, row: DiagnosisRow, page: bytes = b"", model: str = "") -> None:
        """Keep what has become of a diagnosis."""
        with self._writing() as writer:
            diagnosing.update(writer, row, page, model)

    def diagnoses(
        self, twin_id: str | None = None, number: int | None = None
    ) -> list[DiagnosisRow]:
        """Read diagnoses in order: of a twin, or of all, or the one of a number."""
        with self._reading() as reader:
            return diagnosing.select(reader, twin_id, number)

    def diagnosis_page(self, number: int) -> bytes | None:
        """Read the page of a diagnosis; None where it has none."""
        with self._reading() as reader:
            return diagnosing.page_of(reader, number)

    def diagnosis_model(self, number: int) -> str | None:
        """Read the augmented model of a diagnosis; None where it has none."""
        with self._reading() as reader:
            return diagnosing.model_of(reader, number)

    def check(self) -> None:
        """Raise where nothing can be written or read any more."""
        with self._writing() as writer:
            writer.execute("insert or replace into numbers values ('check', 1)")
        self._ask("select 1 from features limit 1")

    def close(self) -> None:
        """Leave; readers in other threads must have ended."""
        with self._lock:
            self._closed = True
            for reader in self._readers:
                reader.close()
            self._readers.clear()
            self._writer.close()

    def _prepare(self) -> None:
        application, version = (
            self._writer.execute(f"pragma {name}").fetchone()[0]
            for name in ("application_id", "user_version")
        )
        tables = self._writer.execute("select count(*) from sqlite_master").fetchone()[0]
        if (application, version) == (APPLICATION, VERSION):
            return
        if application == APPLICATION and version in _ADDED:
            self._writer.executescript(
                f"begin;{_ADDED[version]}pragma user_version={VERSION};commit;"
            )
            return
        if tables:
            raise WrongStoreError(
                f"{self.path} is "
                + (
                    f"a database of version {version}; this software reads {VERSION}. "
                    if application == APPLICATION
                    else "another program's database. "
                )
                + "Give another --database; what was recorded can be replayed into it."
            )
        schema = importlib.resources.files(__package__).joinpath("schema.sql").read_text()
        self._writer.executescript(
            f"begin;{schema}{diagnosing.TABLE}pragma application_id={APPLICATION};"
            f"pragma user_version={VERSION};commit;"
        )

    @contextlib.contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        """Hold the writer in a transaction; within another one, a part of that."""
        with self._lock:
            if self._writer.in_transaction:
                yield self._writer
                return
            try:
                with self._transaction():
                    yield self._writer
            except sqlite3.Error as error:
                raise StoreError(
                    f"{self.path} cannot be written: {error}. Nothing of this batch is kept. "
                    "Make room on the disk, or give another --database."
                ) from error

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        self._writer.execute("begin immediate")
        try:
            yield
            self._writer.execute("commit")
        except BaseException:
            # A full disk may have ended the transaction already.
            with contextlib.suppress(sqlite3.OperationalError):
                self._writer.execute("rollback")
            raise

    @contextlib.contextmanager
    def _reading(self) -> Iterator[sqlite3.Connection]:
        """Hold a connection of this thread that sees one moment of the database."""
        reader: sqlite3.Connection | None = getattr(self._local, "reader", None)
        if reader is None or self._closed:
            reader = self._local.reader = self._open_reader()
        if reader.in_transaction:
            yield reader
            return
        reader.execute("begin")
        try:
            yield reader
        finally:
            reader.execute("rollback")

    def _open_reader(self) -> sqlite3.Connection:
        with self._lock:
            if self._closed:
                raise sqlite3.ProgrammingError(f"{self.path} has been closed.")
            reader = sqlite3.connect(
                f"{self.path.absolute().as_uri()}?mode=ro",
                uri=True,
                isolation_level=None,
                check_same_thread=False,
                timeout=10.0,
            )
            self._readers.append(reader)
            return reader

    def _ask(self, question: str, parameters: Sequence[object] = ()) -> list[Any]:
        with self._reading() as reader:
            return reader.execute(question, parameters).fetchall()

    def _note_slow_times(
        self, writer: sqlite3.Connection, features: Sequence[FeatureRow]
    ) -> None:
        """Remember of each boot whether slow time always rose, so that it can be searched."""
        of_run: dict[int, list[float]] = {}
        for row in features:
            of_run.setdefault(row.number, []).append(row.slow_time)
        writer.executemany(
            "update runs set slow_rises = slow_rises and ? and "
            "coalesce(slow_last, ?) <= ?, slow_last = ? where number = ?",
            [
                (_rises(times), times[0], times[0], times[-1], number)
                for number, times in of_run.items()
            ],
        )


_LOW = (1 << SHIFT) - 1


_AT_ONCE = 1_000


def _rises(times: Sequence[float]) -> bool:
    return all(a <= b for a, b in itertools.pairwise(times))


def _following_place(writer: sqlite3.Connection) -> int:
    place: int = writer.execute("select coalesce(max(place), 0) + 1 from twins").fetchone()[0]
    return place


def _insert_event(writer: sqlite3.Connection, event: EventRow) -> int:
    number = writer.execute(
        "insert into events (twin, site, asset, t_ns, slow_time, derived, body) "
        "values (?,?,?,?,?,?,?)",
        (f"{event.site}.{event.asset}", *event[1:]),
    ).lastrowid
    assert number is not None
    return number


def _states(
    reader: sqlite3.Connection,
    spans: Sequence[Span],
    slow_time: tuple[float | None, float | None],
    limit: int | None,
    newest: bool,
) -> list[tuple[int, bytes]]:
    """Ids and states of `spans` in order, of those whose slow time does not rise filtered."""
    first, last = slow_time
    rows: list[tuple[int, bytes]] = []
    for span in reversed(spans) if newest else spans:
        left = -1 if limit is None else limit - len(rows)
        if left == 0 or span.last < span.first:
            continue
        rows += reader.execute(
            "select id, state from features where id between ? and ? "
            + ("" if span.rises else "and slow_time >= ? and slow_time <= ? ")
            + f"order by id {'desc' if newest else 'asc'} limit ?",
            (
                span.first,
                span.last,
                *(
                    ()
                    if span.rises
                    else (
                        -1e308 if first is None else first,
                        1e308 if last is None else last,
                    )
                ),
                left,
            ),
        ).fetchall()
    return rows[::-1] if newest else rows

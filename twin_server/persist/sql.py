"""The store in SQL that SQLite and PostgreSQL both speak; connections are theirs."""

import abc
import contextlib
import itertools
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple, Protocol

from slowtime_services.ledger import Entry, Link
from slowtime_services.ledger import chain as kinds
from twin_server.events.asset_events import AssetEventRow
from twin_server.events.deliveries import Acknowledgement, Delivery, State, Tally
from twin_server.history.buckets import Buckets, thin
from twin_server.history.states import from_bytes
from twin_server.persist.tables.rows import (
    DetailRow,
    EventRow,
    FeatureRow,
    RunRow,
    StateRow,
    TwinRow,
)

from .store import History, ThinnedHistory, WriteBatch
from .tables import (
    asset_events as asset_events_table,
)
from .tables import (
    composites as composites_table,
)
from .tables import (
    deliveries as deliveries_table,
)
from .tables import (
    diagnoses as diagnoses_table,
)
from .tables import (
    fatigue as fatigue_table,
)
from .tables import (
    ledger as ledger_table,
)
from .tables.checksums import (
    EVENTS,
    FEATURES,
    HELD,
    NUMBERS,
    RUNS,
    TWINS,
    Table,
    damaged,
    opened,
    seal,
)
from .tables.composites import CompositeRow
from .tables.details import changes, column, delete_details, has_details, insert_details
from .tables.diagnoses import DiagnosisRow
from .tables.digests import HashedRow, RollingHash, insert_digests, rolled
from .tables.levels import GrownBoot, build, coarse, delete_levels, extend
from .tables.search import SHIFT, Span, spans_by_slow_time, spans_by_time, whole


class Connection(Protocol):
    """What is asked of a connection; question marks stand for parameters."""

    def execute(self, question: str, parameters: Sequence[Any] = ..., /) -> Any:
        """Ask, and give a cursor over the answer."""
        ...

    def executemany(self, question: str, parameters: Iterable[Sequence[Any]], /) -> Any:
        """Do the same with each of some parameters."""
        ...


class SqlStore(abc.ABC):
    """All of a store but its connections."""

    def __init__(self) -> None:
        self._hashes = HistoryHashes()
        self._ends = ledger_table.ChainEnds()

    @abc.abstractmethod
    def _writing(self) -> contextlib.AbstractContextManager[Connection]:
        """Hold the writer in a transaction; within another one, a part of that."""

    @abc.abstractmethod
    def _reading(self) -> contextlib.AbstractContextManager[Connection]:
        """Hold a connection that sees one moment of the database."""

    def twins(self) -> list[TwinRow]:
        """All twins, in the order of their registration."""
        return [TwinRow(*row[2:]) for row in self._all(TWINS)]

    def twin(self, twin_id: str) -> TwinRow | None:
        """One twin."""
        rows = self._all(TWINS, "where id = ?", (twin_id,))
        return TwinRow(*rows[0][2:]) if rows else None

    def runs(self) -> tuple[list[RunRow], int]:
        """All boots in order, and the number the next one gets."""
        with self._reading() as reader:
            rows = _select(reader, RUNS)
            kept = _number(reader, "run") or 1
        runs = [RunRow(*row[:11])._replace(closed=bool(row[9])) for row in rows]
        return runs, max(kept, runs[-1].number + 1 if runs else 1)

    def held(self) -> list[tuple[int, int, bytes]]:
        """Boot number, sequence and bytes of all features kept until their turn."""
        return self._all(HELD)

    def write(self, cut: WriteBatch) -> list[int]:
        """Make `cut` durable; give the numbers of its events."""
        news: dict[str, RollingHash | None] = {}
        try:
            with self._writing() as writer:
                numbers = self._write(writer, cut, news)
        except BaseException:
            self._hashes.settle({twin_id: None for twin_id, one in news.items() if one is None})
            self._ends.forget()
            raise
        self._hashes.settle(news)
        return numbers

    def _write(
        self, writer: Connection, cut: WriteBatch, news: dict[str, RollingHash | None]
    ) -> list[int]:
        """Write all of a cut; what its histories' hashes will be then is put into `news`."""
        registered = _write_twins(writer, cut.twins)
        written = _write_runs(writer, cut.runs, cut.features)
        _insert(
            writer,
            FEATURES,
            ((n << SHIFT | s, t, float(slow), m, b) for n, s, t, slow, m, b in cut.features),
        )
        insert_details(writer, cut.details)
        extend(writer, [grown for _, _, grown in written])
        self._roll(writer, cut, written, news)
        _insert(writer, HELD, cut.held, otherwise="on conflict do nothing")
        if cut.released:
            writer.executemany(
                "delete from held where number = ? and sequence = ?", cut.released
            )
        deliveries_table.insert(writer, cut.deliveries)
        deliveries_table.settle(writer, cut.settled)
        deliveries_table.acknowledge(writer, cut.acknowledgements)
        asset_events_table.insert(writer, cut.asset_events)
        self._chain(writer, cut, registered, written)
        return _insert_events(writer, cut.events)

    def _chain(
        self,
        writer: Connection,
        cut: WriteBatch,
        registered: dict[str, str],
        written: Sequence["WrittenBoot"],
    ) -> None:
        """Enter what `cut` accepts into the ledger, a block a twin."""
        entries: dict[str, list[Entry]] = {
            twin_id: [ledger_table.of_registration(text)]
            for twin_id, text in registered.items()
        }
        of_run: dict[int, list[tuple[int, int, float, bytes]]] = {}
        for n, s, t_ns, slow, message, _ in cut.features:
            of_run.setdefault(n, []).append((n << SHIFT | s, t_ns, slow, message))
        for twin_id, boot, grown in written:
            found = ledger_table.of_features(of_run.get(grown.number, ()), boot)
            entries.setdefault(twin_id, []).extend(found)
        for twin_id, theirs in ledger_table.of_acknowledgements(cut.acknowledgements):
            entries.setdefault(twin_id, []).extend(theirs)
        for row in cut.asset_events:
            entries.setdefault(row.twin, []).append(ledger_table.of_asset_event(row))
        for twin_id, theirs in entries.items():
            self._ends.append(writer, twin_id, theirs)

    def _roll(
        self,
        writer: Connection,
        cut: WriteBatch,
        written: Sequence["WrittenBoot"],
        news: dict[str, RollingHash | None],
    ) -> None:
        """Roll on the hashes of the histories that `cut` makes longer, and keep some.

        Of a history in which rows were put before others there is none in `news`.
        """
        bodies = {(d.number, d.sequence): d.body for d in cut.details}
        of_run: dict[int, list[HashedRow]] = {}
        for n, s, _, _, message, state in cut.features:
            row = HashedRow(n << SHIFT | s, message, state, bodies.get((n, s)))
            of_run.setdefault(n, []).append(row)
        kept: list[tuple[int, int, str]] = []
        for twin_id, boot, grown in written:
            if grown.number not in of_run:
                continue
            rows = of_run[grown.number]
            rolling = news[twin_id] if twin_id in news else self._hashes.known(twin_id)
            spans = [] if rolling is not None else whole(writer, twin_id)
            if rolling is None and not _has_rows_before(spans, grown):
                rolling = RollingHash()
            if rolling is not None and rolling.last < rows[0].key:
                kept += rolled(rolling, rows, boot)
                news[twin_id] = rolling
                continue
            news[twin_id] = None
            self._hashes.lose(twin_id)
            for span in spans or whole(writer, twin_id):
                # What follows a row that was put before it has another hash now.
                since = max(span.first, rows[0].key)
                writer.execute(
                    "delete from digests where id between ? and ?", (since, span.last)
                )
        insert_digests(writer, kept)

    def messages(self, twin_id: str, after: tuple[int, int], limit: int) -> list[FeatureRow]:
        """Read the next features of a twin, in order, after (boot number, sequence)."""
        floor = (after[0] << SHIFT) + after[1] + 1
        rows: list[Any] = []
        with self._reading() as reader:
            for span in whole(reader, twin_id):
                if span.last >= floor and len(rows) < limit:
                    where = "where id between ? and ?"
                    asked = (max(span.first, floor), span.last)
                    rows += _select(reader, FEATURES, where, asked, limit - len(rows))
        return [FeatureRow(key >> SHIFT, key & _LOW, *rest) for key, *rest in rows]

    def rewrite(
        self,
        twin_id: str,
        states: Iterable[StateRow],
        finish: Callable[[], tuple[TwinRow, Sequence[EventRow]]],
    ) -> None:
        """Replace a twin's states, its registration and its derived events, all at once."""
        with self._remade(twin_id) as writer:
            delete_details(writer, twin_id)
            spans = whole(writer, twin_id)
            _delete_derived(writer, spans)
            self._ends.append(writer, twin_id, [ledger_table.of_act(kinds.ANEW)])
            rows = iter(states)
            while part := list(itertools.islice(rows, _AT_ONCE)):
                keys = [row.number << SHIFT | row.sequence for row in part]
                writer.executemany(
                    "update features set state = ?, state_crc = ? where id = ?",
                    [
                        (row.state, seal(key, row.state), key)
                        for key, row in zip(keys, part, strict=True)
                    ],
                )
                insert_details(
                    writer,
                    [DetailRow(r.number, r.sequence, *r.detail) for r in part if r.detail],
                )
            for span in spans:
                build(writer, span.number)
            twin, events = finish()
            writer.execute("delete from events where twin = ? and derived = 1", (twin_id,))
            self.write(WriteBatch(twins=[twin], events=list(events)))

    def delete(self, twin_id: str) -> bool:
        """Forget a twin and all it has seen; False where there is none."""
        with self._remade(twin_id) as writer:
            following = self.runs()[1]
            delete_details(writer, twin_id)
            spans = whole(writer, twin_id)
            _delete_derived(writer, spans)
            for span in spans:
                writer.execute(
                    "delete from features where id between ? and ?", (span.first, span.last)
                )
                writer.execute("delete from held where number = ?", (span.number,))
            for table in (
                "runs", "events", "diagnoses", "deliveries", "acknowledgements", "asset_events",
                "fatigue",
            ):  # fmt: skip
                writer.execute(f"delete from {table} where twin = ?", (twin_id,))
            _note_number(writer, "run", following)
            existed = writer.execute("delete from twins where id = ?", (twin_id,)).rowcount
            if existed > 0:
                self._ends.append(writer, twin_id, [ledger_table.of_act(kinds.DELETED)])
            return bool(existed > 0)

    @contextlib.contextmanager
    def _remade(self, twin_id: str) -> Iterator[Connection]:
        """Hold the writer while a history is made anew or goes; all of it, or nothing."""
        with self._hashes.remade(twin_id):
            try:
                with self._writing() as writer:
                    yield writer
            except BaseException:
                self._ends.forget()
                raise

    def history(
        self,
        twin_id: str,
        *,
        t_ns: tuple[int | None, int | None] = (None, None),
        slow_time: tuple[float | None, float | None] = (None, None),
        after: tuple[int, int] | None = None,
        limit: int | None = None,
        newest: bool = False,
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
            bodies = column(reader, keys, "body") if has_details(reader, keys) else ()
        return History(states, [key >> SHIFT for key in keys], boots, bodies)

    def thinned(
        self,
        twin_id: str,
        max_points: int,
        *,
        t_ns: tuple[int | None, int | None] = (None, None),
        slow_time: tuple[float | None, float | None] = (None, None),
    ) -> ThinnedHistory:
        """At most `max_points` states between two times, and of what all of them show."""
        with self._reading() as reader:
            spans = whole(reader, twin_id)
            boots = {span.number: (span.boot, span.unit) for span in spans}
            ends = {span.number: span.last for span in spans}
            spans = spans_by_time(reader, spans, *t_ns)
            spans = spans_by_slow_time(reader, spans, *slow_time)
            coarsened = None
            if all(span.rises for span in spans):
                coarsened = coarse(reader, spans, ends, _LOOKED_AT * max_points)
            if coarsened is not None and coarsened.head["count"].sum() <= max_points:
                # So sparse are the sequences that all states fit.
                coarsened = None
            if coarsened is not None:
                keys = coarsened.picked(max_points).tolist()
                rows = _states_of(reader, keys)
                states = from_bytes(rows[key] for key in keys)
            else:
                every = _states(reader, spans, slow_time, None, False)
                states, keys = from_bytes(state for _, state in every), [k for k, _ in every]
                if len(states) > max_points:
                    detailed = has_details(reader, keys)
                    parameters = changes(reader, keys) if detailed else None
                    bodies = column(reader, keys, "body") if detailed else ()
                    coarsened = Buckets.of_states(keys, states, parameters, bodies)
                    kept = thin(states, max_points, parameters)
                    states, keys = states[kept], [keys[i] for i in kept.tolist()]
            bodies = column(reader, keys, "body") if has_details(reader, keys) else ()
        history = History(states, [key >> SHIFT for key in keys], boots, bodies)
        bands = None if coarsened is None else coarsened.coarser(max(1, max_points // 2))
        return ThinnedHistory(history, bands)

    def count(self, twin_id: str) -> int:
        """How many features a twin has."""
        question = "select count(*) from features where id between ? and ?"
        with self._reading() as reader:
            return sum(
                int(reader.execute(question, (span.first, span.last)).fetchone()[0])
                for span in whole(reader, twin_id)
            )

    def digest(self, twin_id: str) -> tuple[str, int]:
        """SHA-256 over all features of a twin, their states and details, and their number."""
        rolling, settled = self._hashes.begun(twin_id)
        with self._reading() as reader:
            for span in whole(reader, twin_id):
                floor = max(span.first, rolling.last + 1)
                while floor <= span.last and (
                    rows := _select(
                        reader,
                        FEATURES,
                        "where id between ? and ?",
                        (floor, span.last),
                        _AT_ONCE,
                    )
                ):
                    keys = [row[0] for row in rows]
                    bodies = column(reader, keys, "body") or [None] * len(keys)
                    for (key, _, _, message, state), body in zip(rows, bodies, strict=True):
                        rolling.take(HashedRow(key, message, state, body), span.boot)
                    floor = keys[-1] + 1
        self._hashes.offer(twin_id, rolling, settled)
        return rolling.hexadecimal, rolling.count

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
        with self._reading() as reader:
            rows = _select(
                reader, EVENTS, f"where {whose} number > ?", (*parameters, after), limit, newest
            )
        found = [EventRow(row[0], *row[2:])._replace(derived=bool(row[6])) for row in rows]
        return found[::-1] if newest else found

    def add_diagnosis(self, row: DiagnosisRow, kept: int) -> int:
        """Keep a diagnosis that was asked for, and the last `kept` of its twin; its number."""
        with self._writing() as writer:
            number = (_number(writer, "diagnosis") or 0) + 1
            _note_number(writer, "diagnosis", number)
            diagnoses_table.insert(writer, row._replace(number=number))
            diagnoses_table.forget(writer, row.twin, kept)
            return number

    def end_diagnosis(self, row: DiagnosisRow, page: bytes = b"", model: str = "") -> None:
        """Keep what has become of a diagnosis."""
        with self._writing() as writer:
            diagnoses_table.update(writer, row, page, model)

    def diagnoses(
        self, twin_id: str | None = None, number: int | None = None
    ) -> list[DiagnosisRow]:
        """Read diagnoses in order: of a twin, or of all, or the one of a number."""
        with self._reading() as reader:
            return diagnoses_table.select(reader, twin_id, number)

    def diagnosis_page(self, number: int) -> bytes | None:
        """Read the page of a diagnosis; None where it has none."""
        with self._reading() as reader:
            return diagnoses_table.page_of(reader, number)

    def diagnosis_model(self, number: int) -> str | None:
        """Read the augmented model of a diagnosis; None where it has none."""
        with self._reading() as reader:
            return diagnoses_table.model_of(reader, number)

    def deliveries(
        self,
        *,
        twin: str | None = None,
        receiver: str | None = None,
        states: Sequence[State] = (),
        due_ns: int | None = None,
        limit: int = 100,
    ) -> list[Delivery]:
        """Read deliveries: those due first, or without `due_ns` the newest first."""
        with self._reading() as reader:
            return deliveries_table.select(reader, twin, receiver, states, due_ns, limit)

    def settle(self, settled: Sequence[Delivery], begun: Sequence[Delivery] = ()) -> None:
        """Keep what has become of deliveries that are open still, and begin others."""
        with self._writing() as writer:
            deliveries_table.settle(writer, settled)
            deliveries_table.insert(writer, begun)

    def tallies(self) -> list[Tally]:
        """Count deliveries by twin, receiver and state."""
        with self._reading() as reader:
            return deliveries_table.tallies(reader)

    def forget_deliveries(self, before_ns: int) -> None:
        """Drop those that ended before then."""
        with self._writing() as writer:
            deliveries_table.forget(writer, before_ns)

    def acknowledgements(self, twin_id: str) -> dict[str, Acknowledgement]:
        """Read who has taken note of which alarms of a twin."""
        with self._reading() as reader:
            return deliveries_table.acknowledged(reader, twin_id)

    def composites(self, composite: str | None = None) -> list[CompositeRow]:
        """Read what was registered of composites, or of one, in order."""
        with self._reading() as reader:
            return composites_table.read(reader, composite)

    def add_composites(self, rows: Sequence[CompositeRow]) -> None:
        """Keep what was registered, all at once, under the next numbers."""
        with self._writing() as writer:
            following = (_number(writer, "composite") or 0) + 1
            composites_table.insert(writer, rows, following)
            if rows:
                _note_number(writer, "composite", following + len(rows) - 1)

    def asset_events(self, twin_id: str) -> list[AssetEventRow]:
        """Read what people have told of an asset, in the order in which it was accepted."""
        with self._reading() as reader:
            return asset_events_table.read(reader, twin_id)

    def ends(self) -> dict[str, Link]:
        """End of the chain of each twin, of deleted ones as well."""
        with self._writing() as writer:
            return self._ends.all(writer)

    def entries(self, twin_id: str, after: int) -> list[Entry]:
        """Read the entries of a twin's chain behind so many."""
        with self._reading() as reader:
            return ledger_table.entries(reader, twin_id, after)

    def add_head(self, row: ledger_table.HeadRow) -> None:
        """Keep a signed head."""
        with self._writing() as writer:
            ledger_table.insert_head(writer, row)

    def heads(
        self, *, after: int = 0, limit: int = 1000, newest: bool = False
    ) -> list[ledger_table.HeadRow]:
        """Read signed heads, in order."""
        with self._reading() as reader:
            return ledger_table.heads(reader, after, limit, newest)

    def add_fatigue(self, rows: Sequence[fatigue_table.FatigueRow]) -> None:
        """Keep fatigue messages; of a boot and hour the newest stays."""
        with self._writing() as writer:
            fatigue_table.insert(writer, rows)

    def fatigue(self, twin_id: str) -> list[fatigue_table.FatigueRow]:
        """Read the fatigue messages of a twin in the order of time."""
        with self._reading() as reader:
            return fatigue_table.select(reader, twin_id)

    def check(self) -> None:
        """Raise where nothing can be written or read any more."""
        with self._writing() as writer:
            _note_number(writer, "check", 1)
        with self._reading() as reader:
            reader.execute("select 1 from features limit 1").fetchone()

    def _all(self, table: Table, where: str = "", parameters: Sequence[Any] = ()) -> list[Any]:
        with self._reading() as reader:
            return _select(reader, table, where, parameters)


class WrittenBoot(NamedTuple):
    """A boot that was written: of which twin, its name, and how it has grown."""

    twin_id: str
    boot: str
    grown: GrownBoot


def _has_rows_before(spans: Sequence[Span], grown: GrownBoot) -> bool:
    return grown.before >= 0 or any(
        span.last >= span.first for span in spans if span.number != grown.number
    )


class HistoryHashes:
    """Hashes of histories as they are now, of each twin that was written or asked about."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._found: dict[str, RollingHash] = {}
        self._being_made: set[str] = set()
        self._times_made: dict[str, int] = {}

    def adopt(self, found: dict[str, RollingHash]) -> None:
        """Begin with what has been rolled while all was looked through."""
        with self._lock:
            self._found.update(found)

    def known(self, twin_id: str) -> RollingHash | None:
        """Give a hash to roll on, where there is one."""
        with self._lock:
            found = self._found.get(twin_id)
            return None if found is None else found.copy()

    def lose(self, twin_id: str) -> None:
        """Know nothing of a history until `settle`: it will not be what it was, longer."""
        with self._lock:
            self._found.pop(twin_id, None)
            self._being_made.add(twin_id)

    def settle(self, news: dict[str, RollingHash | None]) -> None:
        """Take over what has become durable."""
        with self._lock:
            for twin_id, rolling in news.items():
                if rolling is not None:
                    self._found[twin_id] = rolling
                else:
                    self._forget(twin_id)

    @contextlib.contextmanager
    def remade(self, twin_id: str) -> Iterator[None]:
        """Know nothing of a history while it is made anew, nor of the one before it."""
        self.lose(twin_id)
        try:
            yield
        finally:
            with self._lock:
                self._forget(twin_id)

    def _forget(self, twin_id: str) -> None:
        self._found.pop(twin_id, None)
        self._times_made[twin_id] = self._times_made.get(twin_id, 0) + 1
        self._being_made.discard(twin_id)

    def begun(self, twin_id: str) -> tuple[RollingHash, int | None]:
        """Give what is known of a history, and what to `offer` one that goes further with."""
        with self._lock:
            if twin_id in self._being_made:
                return RollingHash(), None
            found = self._found.get(twin_id)
            made = self._times_made.get(twin_id, 0)
            return (RollingHash() if found is None else found.copy()), made

    def offer(self, twin_id: str, rolling: RollingHash, made: int | None) -> None:
        """Keep a hash for the next time, unless the history was made anew meanwhile."""
        with self._lock:
            before = self._found.get(twin_id)
            if (
                made is not None
                and made == self._times_made.get(twin_id, 0)
                and twin_id not in self._being_made
                and (before is None or before.count < rolling.count)
            ):
                self._found[twin_id] = rolling


_LOW = (1 << SHIFT) - 1
_LOOKED_AT = 4
"""Buckets that are looked at for each point of a thinned history."""
_AT_ONCE = 1_000
_ASKED = 500
_ALL = 1 << 62


def _select(
    reader: Connection,
    table: Table,
    where: str = "",
    parameters: Sequence[Any] = (),
    limit: int = _ALL,
    newest: bool = False,
) -> list[Any]:
    """Rows in the order of their key, each of which is sound."""
    rows = reader.execute(
        f"select {', '.join(table.all_columns)} from {table.name} {where} "
        f"order by {table.key} {'desc' if newest else ''} limit ?",
        (*parameters, limit),
    )
    return opened(table, rows)


def _insert(
    writer: Connection,
    table: Table,
    rows: Iterable[Sequence[object]],
    *,
    otherwise: str = "",
) -> None:
    sealed = [table.sealed(row) for row in rows]
    if sealed:
        names = table.all_columns
        writer.executemany(
            f"insert into {table.name} ({', '.join(names)}) "
            f"values ({','.join('?' * len(names))}) {otherwise}",
            sealed,
        )


def insert_all(writer: Connection, table: Table, rows: Iterable[Sequence[object]]) -> None:
    """Insert rows of another store as they are."""
    _insert(writer, table, rows)


def _upsert(writer: Connection, table: Table, rows: Iterable[Sequence[object]]) -> None:
    """Insert rows whose first column is their key, or replace those of the same key."""
    key, *others = table.all_columns
    changed = ", ".join(f"{name} = excluded.{name}" for name in others)
    _insert(writer, table, rows, otherwise=f"on conflict ({key}) do update set {changed}")


def _known(writer: Connection, table: Table, keys: Sequence[object]) -> dict[Any, Any]:
    """Rows of the given keys, by them."""
    found: dict[Any, Any] = {}
    for first in range(0, len(keys), _ASKED):
        asked = keys[first : first + _ASKED]
        where = f"where {table.columns[0]} in ({','.join('?' * len(asked))})"
        found |= {row[0]: row for row in _select(writer, table, where, asked)}
    return found


def _number(reader: Connection, what: str) -> int | None:
    rows = _select(reader, NUMBERS, "where what = ?", (what,))
    return int(rows[0][1]) if rows else None


def _note_number(writer: Connection, what: str, value: int) -> None:
    _upsert(writer, NUMBERS, [(what, value)])


def _write_twins(writer: Connection, twins: Sequence[TwinRow]) -> dict[str, str]:
    """Keep twins; give the registrations that are not what they were, by twin."""
    if not twins:
        return {}
    newest = {twin.id: twin for twin in twins}
    known = _known(writer, TWINS, list(newest))
    places = {key: row[1] for key, row in known.items()}
    if len(places) < len(newest):
        last = writer.execute("select coalesce(max(place), 0) from twins").fetchone()[0]
        following = itertools.count(last + 1)
        places |= {key: next(following) for key in newest if key not in places}
    _upsert(writer, TWINS, [(key, places[key], *twin) for key, twin in newest.items()])
    return {
        key: twin.registration
        for key, twin in newest.items()
        if key not in known or known[key][4] != twin.registration
    }


def _write_runs(
    writer: Connection, runs: Sequence[RunRow], features: Sequence[FeatureRow]
) -> list[WrittenBoot]:
    """Keep accounts, and of each boot whether slow time always rose: so it can be searched.

    Returns
    -------
    The boots in order, and how each has grown.
    """
    times: dict[int, list[float]] = {}
    for feature in features:
        times.setdefault(feature.number, []).append(float(feature.slow_time))
    given = {run.number: run for run in runs}
    known = _known(writer, RUNS, list(given.keys() | times.keys()))
    rows, written = [], []
    for number in sorted(given.keys() | times.keys()):
        before = known.get(number)
        last, rises = before[12:14] if before is not None else (None, 1)
        run = given[number] if number in given else RunRow(*known[number][:11])
        theirs = times.get(number)
        if theirs:
            rises = int(bool(rises) and (last is None or last <= theirs[0]) and _rise(theirs))
            last = theirs[-1]
        account = (*run[:9], int(run.closed), run.lost)
        twin_id = f"{run.site}.{run.asset}"
        rows.append((*account, twin_id, last, rises))
        grown = GrownBoot(number, -1 if before is None else before[6], run.last)
        written.append(WrittenBoot(twin_id, run.boot, grown))
    _upsert(writer, RUNS, rows)
    return written


def _rise(times: Sequence[float]) -> bool:
    return all(a <= b for a, b in itertools.pairwise(times))


def _insert_events(writer: Connection, events: Sequence[EventRow]) -> list[int]:
    if not events:
        return []
    first = (_number(writer, "event") or 0) + 1
    numbers = list(range(first, first + len(events)))
    _note_number(writer, "event", numbers[-1])
    _insert(
        writer,
        EVENTS,
        (
            (
                n,
                f"{e.site}.{e.asset}",
                e.site,
                e.asset,
                e.t_ns,
                e.slow_time,
                int(e.derived),
                e.body,
            )
            for n, e in zip(numbers, events, strict=True)
        ),
    )
    return numbers


def _delete_derived(writer: Connection, spans: Sequence[Span]) -> None:
    """Drop what was made out of features, to be made again."""
    delete_levels(writer, spans)
    for span in spans:
        writer.execute("delete from digests where id between ? and ?", (span.first, span.last))


def _states_of(reader: Connection, keys: Sequence[int]) -> dict[int, bytes]:
    """States of some keys, by them."""
    found: dict[int, bytes] = {}
    for first in range(0, len(keys), _ASKED):
        asked = keys[first : first + _ASKED]
        for key, state, crc in reader.execute(
            "select id, state, state_crc from features "
            f"where id in ({','.join('?' * len(asked))})",
            asked,
        ):
            if seal(key, state) != crc:
                raise damaged(
                    f"The state of feature {key & _LOW} of boot number {key >> SHIFT}"
                )
            found[key] = state
    if len(found) < len(keys):
        raise damaged("A bucket of states, or a state that it names,")
    return found


def _states(
    reader: Connection,
    spans: Sequence[Span],
    slow_time: tuple[float | None, float | None],
    limit: int | None,
    newest: bool,
) -> list[tuple[int, bytes]]:
    """Ids and states of `spans` in order, of those whose slow time does not rise filtered."""
    low, high = slow_time
    between = (-1e308 if low is None else low, 1e308 if high is None else high)
    rows: list[tuple[int, bytes]] = []
    for span in reversed(spans) if newest else spans:
        left = _ALL if limit is None else limit - len(rows)
        if left == 0 or span.last < span.first:
            continue
        found: Iterator[tuple[int, bytes, int]] = reader.execute(
            "select id, state, state_crc from features where id between ? and ? "
            + ("" if span.rises else "and slow_time >= ? and slow_time <= ? ")
            + f"order by id {'desc' if newest else 'asc'} limit ?",
            (span.first, span.last, *(() if span.rises else between), left),
        )
        for key, state, crc in found:
            if seal(key, state) != crc:
                raise damaged(f"The state of feature {key & _LOW} of boot {span.boot}")
            rows.append((key, state))
    return rows[::-1] if newest else rows

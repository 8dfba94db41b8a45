"""The store in SQL that SQLite and PostgreSQL both speak; connections are theirs."""

import abc
import contextlib
import hashlib
import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Protocol

from twin_server.states import from_bytes

from . import diagnosing
from .detailing import changes, column, delete_details, has_details, insert_details
from .diagnosing import DiagnosisRow
from .sealing import EVENTS, FEATURES, HELD, NUMBERS, RUNS, TWINS, Table, damaged, opened, seal
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
    TwinRow,
)


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

    def write(self, cut: Cut) -> list[int]:
        """Make `cut` durable; give the numbers of its events."""
        with self._writing() as writer:
            _write_twins(writer, cut.twins)
            _write_runs(writer, cut.runs, cut.features)
            _insert(
                writer,
                FEATURES,
                (
                    (n << SHIFT | s, t, float(slow), m, b)
                    for n, s, t, slow, m, b in cut.features
                ),
            )
            insert_details(writer, cut.details)
            _insert(writer, HELD, cut.held, otherwise="on conflict do nothing")
            if cut.released:
                writer.executemany(
                    "delete from held where number = ? and sequence = ?", cut.released
                )
            return _insert_events(writer, cut.events)

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
        with self._writing() as writer:
            delete_details(writer, twin_id)
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
            twin, events = finish()
            writer.execute("delete from events where twin = ? and derived = 1", (twin_id,))
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
            _note_number(writer, "run", following)
            existed = writer.execute("delete from twins where id = ?", (twin_id,)).rowcount
            return bool(existed > 0)

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
        question = "select count(*) from features where id between ? and ?"
        with self._reading() as reader:
            return sum(
                int(reader.execute(question, (span.first, span.last)).fetchone()[0])
                for span in whole(reader, twin_id)
            )

    def digest(self, twin_id: str) -> tuple[str, int]:
        """SHA-256 over all features of a twin, their states and details, and their number."""
        digest, count = hashlib.sha256(), 0
        with self._reading() as reader:
            for span in whole(reader, twin_id):
                floor = span.first
                while rows := _select(
                    reader, FEATURES, "where id between ? and ?", (floor, span.last), _AT_ONCE
                ):
                    keys = [row[0] for row in rows]
                    bodies = column(reader, keys, "body") or [None] * len(keys)
                    for (key, _, _, message, state), body in zip(rows, bodies, strict=True):
                        head = f"{span.boot} {key & _LOW} {len(message)} {len(state)}\n"
                        digest.update(head.encode() + message + state + (body or b""))
                    count, floor = count + len(rows), keys[-1] + 1
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
            diagnosing.insert(writer, row._replace(number=number))
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
            _note_number(writer, "check", 1)
        with self._reading() as reader:
            reader.execute("select 1 from features limit 1").fetchone()

    def _all(self, table: Table, where: str = "", parameters: Sequence[Any] = ()) -> list[Any]:
        with self._reading() as reader:
            return _select(reader, table, where, parameters)


_LOW = (1 << SHIFT) - 1
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


def _write_twins(writer: Connection, twins: Sequence[TwinRow]) -> None:
    if not twins:
        return
    newest = {twin.id: twin for twin in twins}
    places = {key: row[1] for key, row in _known(writer, TWINS, list(newest)).items()}
    if len(places) < len(newest):
        last = writer.execute("select coalesce(max(place), 0) from twins").fetchone()[0]
        following = itertools.count(last + 1)
        places |= {key: next(following) for key in newest if key not in places}
    _upsert(writer, TWINS, [(key, places[key], *twin) for key, twin in newest.items()])


def _write_runs(
    writer: Connection, runs: Sequence[RunRow], features: Sequence[FeatureRow]
) -> None:
    """Keep accounts, and of each boot whether slow time always rose: so it can be searched."""
    times: dict[int, list[float]] = {}
    for feature in features:
        times.setdefault(feature.number, []).append(float(feature.slow_time))
    given = {run.number: run for run in runs}
    known = _known(writer, RUNS, list(given.keys() | times.keys()))
    rows = []
    for number in sorted(given.keys() | times.keys()):
        before = known.get(number)
        last, rises = before[12:14] if before is not None else (None, 1)
        run = given[number] if number in given else RunRow(*known[number][:11])
        theirs = times.get(number)
        if theirs:
            rises = int(bool(rises) and (last is None or last <= theirs[0]) and _rise(theirs))
            last = theirs[-1]
        account = (*run[:9], int(run.closed), run.lost)
        rows.append((*account, f"{run.site}.{run.asset}", last, rises))
    _upsert(writer, RUNS, rows)


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

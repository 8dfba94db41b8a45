"""The store in the SQL that SQLite and PostgreSQL share, without their connections."""

import contextlib
import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from slowtime_services.ledger import chain as kinds
from twin_server.persist.tables.rows import (
    DetailRow,
    EventRow,
    FeatureRow,
    RunRow,
    StateRow,
    TwinRow,
)

from .chains import Journal
from .chains.journal import of_key
from .history_queries import select_boots, select_history, select_neighbours, select_thinned
from .records import SqlRecords
from .store import StoredHistory, ThinnedHistory, WriteBatch
from .tables import asset_events as asset_events_table
from .tables import deliveries as deliveries_table
from .tables import ledger as ledger_table
from .tables import outlooks as outlooks_table
from .tables import quarantine as quarantine_table
from .tables.checksums import (
    ACKNOWLEDGEMENTS,
    ASSET_EVENTS,
    DELIVERIES,
    EVENTS,
    FEATURES,
    HELD,
    OUTLOOKS,
    QUARANTINE,
    RUNS,
    TWINS,
    seal,
)
from .tables.counted import count_of, key_after
from .tables.details import column, delete_details, insert_details
from .tables.digests import HashedRow, RollingHash
from .tables.levels import build, delete_levels, extend
from .tables.search import SHIFT, Span, current_runs, whole
from .tables.statements import Connection, absent, insert, last_number, note_number, select
from .tables.twins import WrittenBoot, insert_events, write_twins

_SEQUENCE = (1 << SHIFT) - 1

_ROWS_AT_ONCE = 1_000
"""Rows of a history that are rewritten by one statement."""


class SqlStore(SqlRecords):
    """All of a store but its connections."""

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
            rows = current_runs(reader, select(reader, RUNS))
            kept = last_number(reader, "run") or 1
        runs = [RunRow(*row[:11])._replace(closed=bool(row[9])) for row in rows]
        return runs, max(kept, runs[-1].number + 1 if runs else 1)

    def boot_number(self, twin_id: str, boot: str) -> int | None:
        """Return the number of a boot of a twin; None where it has none of that name."""
        site, _, asset = twin_id.partition(".")
        rows = self._all(RUNS, "where site = ? and asset = ? and boot = ?", (site, asset, boot))
        return int(rows[0][0]) if rows else None

    def held(self) -> list[tuple[int, int, bytes]]:
        """Boot number, sequence and bytes of all features kept until their turn."""
        return self._all(HELD)

    def write(self, cut: WriteBatch) -> list[int]:
        """Make `cut` durable; give the numbers of its events."""
        news: dict[str, RollingHash | None] = {}
        try:
            with self._chaining() as (writer, journal):
                numbers = self._write(writer, journal, cut, news)
        except BaseException:
            self._hashes.settle({twin_id: None for twin_id, one in news.items() if one is None})
            raise
        self._hashes.settle(news)
        return numbers

    def _write(
        self,
        writer: Connection,
        journal: Journal,
        cut: WriteBatch,
        news: dict[str, RollingHash | None],
    ) -> list[int]:
        """Write all of a cut; the new hashes of its histories are put into `news`."""
        registered, twins = write_twins(writer, cut.twins)
        written, runs = self._runs.write(writer, cut.runs, cut.features)
        journal.know_boots({one.grown.number: one.twin_id for one in written})
        insert(
            writer,
            FEATURES,
            ((n << SHIFT | s, t, float(slow), m, b) for n, s, t, slow, m, b in cut.features),
        )
        insert_details(writer, cut.details)
        extend(writer, [grown for _, _, grown in written])
        _journal_features(journal, cut, registered, written)
        journal.put(TWINS, twins)
        journal.put(RUNS, runs)
        self._hashes.roll(writer, cut.features, cut.details, written, news, journal)
        held = absent(writer, HELD, ("number", "sequence"), cut.held)
        insert(writer, HELD, held)
        journal.put(HELD, held)
        if cut.released:
            writer.executemany(
                "delete from held where number = ? and sequence = ?", cut.released
            )
            journal.remove(
                HELD, ((number, sequence, None) for number, sequence in cut.released)
            )
        journal.put(QUARANTINE, quarantine_table.add(writer, cut.aside))
        journal.put(DELIVERIES, deliveries_table.insert(writer, cut.deliveries))
        journal.put(DELIVERIES, deliveries_table.settle(writer, cut.settled))
        acknowledged = deliveries_table.acknowledge(writer, cut.acknowledgements)
        journal.put(ACKNOWLEDGEMENTS, acknowledged)
        journal.put(ASSET_EVENTS, asset_events_table.insert(writer, cut.asset_events))
        events = insert_events(writer, cut.events)
        journal.put(EVENTS, events)
        return [count_of(row[0]) for row in events]

    def messages(self, twin_id: str, after: tuple[int, int], limit: int) -> list[FeatureRow]:
        """Read the next features of a twin, in order, after (boot number, sequence)."""
        floor = (after[0] << SHIFT) + after[1] + 1
        rows: list[Any] = []
        with self._reading() as reader:
            for span in whole(reader, twin_id):
                if span.last >= floor and len(rows) < limit:
                    where = "where id between ? and ?"
                    asked = (max(span.first, floor), span.last)
                    rows += select(reader, FEATURES, where, asked, limit - len(rows))
        return [FeatureRow(key >> SHIFT, key & _SEQUENCE, *rest) for key, *rest in rows]

    def messages_of_boot(self, number: int, first: int, last: int) -> list[FeatureRow]:
        """Read the features `first` to `last` of the boot of a number, in order."""
        asked = (number << SHIFT | first, number << SHIFT | last)
        rows = self._all(FEATURES, "where id between ? and ?", asked)
        return [FeatureRow(key >> SHIFT, key & _SEQUENCE, *rest) for key, *rest in rows]

    def rewrite(
        self,
        twin_id: str,
        states: Iterable[StateRow],
        finish: Callable[[], tuple[TwinRow, Sequence[EventRow]]],
    ) -> None:
        """Replace a twin's states, its registration and its derived events, all at once."""
        with self._remade(twin_id) as (writer, journal):
            delete_details(writer, twin_id)
            spans = whole(writer, twin_id)
            _delete_derived(writer, spans)
            journal.add(twin_id, [ledger_table.of_act(kinds.ANEW)])
            # They were stated of states that are others now.
            gone = outlooks_table.forget(writer, twin_id)
            journal.remove(OUTLOOKS, (of_key(OUTLOOKS, id=i, twin=twin_id) for i in gone))
            rows = iter(states)
            while part := list(itertools.islice(rows, _ROWS_AT_ONCE)):
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
                for number, group in itertools.groupby(part, lambda row: row.number):
                    journal.put_states(
                        twin_id,
                        [
                            (number << SHIFT | r.sequence, r.state, *(r.detail or (b"", b"")))
                            for r in group
                        ],
                    )
            for span in spans:
                build(writer, span.number)
            twin, events = finish()
            derived = "twin = ? and derived = 1"
            old = writer.execute(f"select number from events where {derived}", (twin_id,))
            rows_gone = [of_key(EVENTS, number=row[0], twin=twin_id) for row in old.fetchall()]
            writer.execute(f"delete from events where {derived}", (twin_id,))
            journal.remove(EVENTS, rows_gone)
            self.write(WriteBatch(twins=[twin], events=list(events)))

    def delete(self, twin_id: str) -> bool:
        """Forget a twin and all it has seen; False where there is none."""
        with self._remade(twin_id) as (writer, journal):
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
                "fatigue", "quarantine", "outlooks",
            ):  # fmt: skip
                writer.execute(f"delete from {table} where twin = ?", (twin_id,))
            self._runs.forget()
            note_number(writer, "run", following)
            existed = writer.execute("delete from twins where id = ?", (twin_id,)).rowcount
            if existed > 0:
                journal.add(twin_id, [ledger_table.of_act(kinds.DELETED)])
            return bool(existed > 0)

    @contextlib.contextmanager
    def _remade(self, twin_id: str) -> Iterator[tuple[Connection, Journal]]:
        """Hold the writer while a history is rewritten or deleted, in one transaction."""
        with self._hashes.remade(twin_id), self._chaining() as (writer, journal):
            yield writer, journal

    def history(
        self,
        twin_id: str,
        *,
        t_ns: tuple[int | None, int | None] = (None, None),
        slow_time: tuple[float | None, float | None] = (None, None),
        after: tuple[int, int] | None = None,
        limit: int | None = None,
        newest: bool = False,
    ) -> StoredHistory:
        """States between two times, both included, or after (boot number, sequence)."""
        with self._reading() as reader:
            return select_history(reader, twin_id, t_ns, slow_time, after, limit, newest)

    def thinned(
        self,
        twin_id: str,
        max_points: int,
        *,
        t_ns: tuple[int | None, int | None] = (None, None),
        slow_time: tuple[float | None, float | None] = (None, None),
    ) -> ThinnedHistory:
        """At most `max_points` states between two times, with statistics of all of them."""
        with self._reading() as reader:
            return select_thinned(reader, twin_id, max_points, t_ns, slow_time)

    def boots(self, twin_id: str) -> list[tuple[int, bytes, int]]:
        """Read number, first message and time of the last one of each boot with readings."""
        with self._reading() as reader:
            return select_boots(reader, twin_id)

    def neighbours(self, number: int, t_ns: int) -> tuple[bytes | None, bytes | None]:
        """Read the last message of a boot that ends by an instant, and the first one after."""
        with self._reading() as reader:
            return select_neighbours(reader, number, t_ns)

    def count(self, twin_id: str) -> int:
        """Count the features of a twin."""
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
                    rows := select(
                        reader,
                        FEATURES,
                        "where id between ? and ?",
                        (floor, span.last),
                        _ROWS_AT_ONCE,
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
        """Events of one twin in order, or of all twins, one behind the other."""
        with self._reading() as reader:
            if twin_id is None:
                rows = select(reader, EVENTS, limit=limit, newest=newest)
            else:
                asked = twin_id, key_after(reader, EVENTS, twin_id, after)
                rows = select(
                    reader, EVENTS, "where twin = ? and number > ?", asked, limit, newest
                )
        found = [
            EventRow(count_of(row[0]), *row[2:])._replace(derived=bool(row[6])) for row in rows
        ]
        return found[::-1] if newest else found

    def check(self) -> None:
        """Raise where nothing can be written or read any more."""
        with self._writing() as writer:
            note_number(writer, "check", 1)
        with self._reading() as reader:
            reader.execute("select 1 from features limit 1").fetchone()


def _delete_derived(writer: Connection, spans: Sequence[Span]) -> None:
    """Delete rows derived from features, so that they are computed again."""
    delete_levels(writer, spans)
    for span in spans:
        writer.execute("delete from digests where id between ? and ?", (span.first, span.last))


def _journal_features(
    journal: Journal,
    cut: WriteBatch,
    registered: dict[str, str],
    written: Sequence[WrittenBoot],
) -> None:
    """Chain the registrations and features that `cut` accepts, and the states of these."""
    for twin_id, text in registered.items():
        journal.add(twin_id, [ledger_table.of_registration(text)])
    details = {(d.number, d.sequence): (d.changes, d.body) for d in cut.details}
    nothing = (b"", b"")
    of_run: dict[int, list[FeatureRow]] = {}
    for row in cut.features:
        of_run.setdefault(row.number, []).append(row)
    for twin_id, boot, grown in written:
        rows = of_run.get(grown.number, ())
        first = grown.number << SHIFT
        accepted = ((first | r.sequence, r.t_ns, r.slow_time, r.message) for r in rows)
        journal.add(twin_id, ledger_table.of_features(accepted, boot))
        journal.put_states(
            twin_id,
            [
                (first | r.sequence, r.state, *details.get((r.number, r.sequence), nothing))
                for r in rows
            ],
        )

"""The store in the SQL that SQLite and PostgreSQL share, without their connections."""

import contextlib
import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from slowtime_services.ledger import Entry, Link
from slowtime_services.ledger import chain as kinds
from twin_server.events.asset_events import AssetEventRow
from twin_server.events.deliveries import Acknowledgement, Delivery, State, Tally
from twin_server.persist.tables.rows import (
    DetailRow,
    EventRow,
    FeatureRow,
    RunRow,
    StateRow,
    TwinRow,
)

from .history_hashes import HistoryHashes
from .history_queries import select_boots, select_history, select_neighbours, select_thinned
from .quarantine import QuarantineTable
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
from .tables import (
    quarantine as quarantine_table,
)
from .tables.checksums import (
    EVENTS,
    FEATURES,
    HELD,
    RUNS,
    TWINS,
    Table,
    seal,
)
from .tables.composites import CompositeRow
from .tables.counted import count_of, key_after
from .tables.details import column, delete_details, insert_details
from .tables.diagnoses import DiagnosisRow
from .tables.digests import HashedRow, RollingHash
from .tables.levels import build, delete_levels, extend
from .tables.search import SHIFT, Span, whole
from .tables.statements import Connection, insert, last_number, note_number, select
from .tables.twins import WrittenBoot, insert_events, write_runs, write_twins

_SEQUENCE = (1 << SHIFT) - 1

_ROWS_AT_ONCE = 1_000
"""Rows of a history that are rewritten by one statement."""


class SqlStore(QuarantineTable):
    """All of a store but its connections."""

    def __init__(self) -> None:
        self._hashes = HistoryHashes()
        self._ends = ledger_table.ChainEnds()

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
            rows = select(reader, RUNS)
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
        """Write all of a cut; the new hashes of its histories are put into `news`."""
        registered = write_twins(writer, cut.twins)
        written = write_runs(writer, cut.runs, cut.features)
        insert(
            writer,
            FEATURES,
            ((n << SHIFT | s, t, float(slow), m, b) for n, s, t, slow, m, b in cut.features),
        )
        insert_details(writer, cut.details)
        extend(writer, [grown for _, _, grown in written])
        self._hashes.roll(writer, cut.features, cut.details, written, news)
        insert(writer, HELD, cut.held, otherwise="on conflict do nothing")
        if cut.released:
            writer.executemany(
                "delete from held where number = ? and sequence = ?", cut.released
            )
        quarantine_table.add(writer, cut.aside)
        deliveries_table.insert(writer, cut.deliveries)
        deliveries_table.settle(writer, cut.settled)
        deliveries_table.acknowledge(writer, cut.acknowledgements)
        asset_events_table.insert(writer, cut.asset_events)
        for twin_id, entries in _ledger_entries(cut, registered, written).items():
            self._ends.append(writer, twin_id, entries)
        return insert_events(writer, cut.events)

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
        with self._remade(twin_id) as writer:
            delete_details(writer, twin_id)
            spans = whole(writer, twin_id)
            _delete_derived(writer, spans)
            self._ends.append(writer, twin_id, [ledger_table.of_act(kinds.ANEW)])
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
                "fatigue", "quarantine",
            ):  # fmt: skip
                writer.execute(f"delete from {table} where twin = ?", (twin_id,))
            note_number(writer, "run", following)
            existed = writer.execute("delete from twins where id = ?", (twin_id,)).rowcount
            if existed > 0:
                self._ends.append(writer, twin_id, [ledger_table.of_act(kinds.DELETED)])
            return bool(existed > 0)

    @contextlib.contextmanager
    def _remade(self, twin_id: str) -> Iterator[Connection]:
        """Hold the writer while a history is rewritten or deleted, in one transaction."""
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

    def add_diagnosis(self, row: DiagnosisRow, kept: int) -> int:
        """Keep a diagnosis that was asked for, and the last `kept` of its twin; its number."""
        with self._writing() as writer:
            number = diagnoses_table.insert(writer, row)
            diagnoses_table.forget(writer, row.twin, kept)
            return number

    def end_diagnosis(self, row: DiagnosisRow, page: bytes = b"", model: str = "") -> None:
        """Store the outcome of a diagnosis."""
        with self._writing() as writer:
            diagnoses_table.update(writer, row, page, model)

    def diagnoses(
        self, twin_id: str | None = None, number: int | None = None
    ) -> list[DiagnosisRow]:
        """Read diagnoses in order: of a twin, or of all, or the one of a number of a twin."""
        with self._reading() as reader:
            return diagnoses_table.select(reader, twin_id, number)

    def diagnosis_page(self, twin_id: str, number: int) -> bytes | None:
        """Read the page of a diagnosis; None where it has none."""
        with self._reading() as reader:
            return diagnoses_table.page_of(reader, twin_id, number)

    def diagnosis_model(self, twin_id: str, number: int) -> str | None:
        """Read the augmented model of a diagnosis; None where it has none."""
        with self._reading() as reader:
            return diagnoses_table.model_of(reader, twin_id, number)

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
        """Store the outcome of open deliveries, and begin others."""
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
        """Read the acknowledgements of alarms of a twin."""
        with self._reading() as reader:
            return deliveries_table.acknowledged(reader, twin_id)

    def composites(self, composite: str | None = None) -> list[CompositeRow]:
        """Read the registrations of all composites, or of one, in order."""
        with self._reading() as reader:
            return composites_table.read(reader, composite)

    def add_composites(self, rows: Sequence[CompositeRow]) -> None:
        """Store registrations, all at once, under the next numbers."""
        with self._writing() as writer:
            following = (last_number(writer, "composite") or 0) + 1
            composites_table.insert(writer, rows, following)
            if rows:
                note_number(writer, "composite", following + len(rows) - 1)

    def asset_events(self, twin_id: str) -> list[AssetEventRow]:
        """Read the reported events of an asset, in the order of acceptance."""
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
            note_number(writer, "check", 1)
        with self._reading() as reader:
            reader.execute("select 1 from features limit 1").fetchone()

    def _all(self, table: Table, where: str = "", parameters: Sequence[Any] = ()) -> list[Any]:
        with self._reading() as reader:
            return select(reader, table, where, parameters)


def _delete_derived(writer: Connection, spans: Sequence[Span]) -> None:
    """Delete rows derived from features, so that they are computed again."""
    delete_levels(writer, spans)
    for span in spans:
        writer.execute("delete from digests where id between ? and ?", (span.first, span.last))


def _ledger_entries(
    cut: WriteBatch,
    registered: dict[str, str],
    written: Sequence[WrittenBoot],
) -> dict[str, list[Entry]]:
    """Make the ledger entries of what `cut` accepts, by twin."""
    entries: dict[str, list[Entry]] = {
        twin_id: [ledger_table.of_registration(text)] for twin_id, text in registered.items()
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
    return entries

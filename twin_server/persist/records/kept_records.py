"""The part of the store that keeps what goes with histories: orders, reports, the ledger."""

import contextlib
from collections.abc import Iterator, Sequence

from slowtime_schemas.answers.alarms import DeliveryState
from slowtime_services.ledger import Entry, Link
from twin_server.events.asset_events import AssetEventRow
from twin_server.events.deliveries import AlarmAcknowledgement, Delivery, DeliveryTally
from twin_server.persist.chains.basis import renew
from twin_server.persist.chains.journal import of_key
from twin_server.persist.tables import asset_events as asset_events_table
from twin_server.persist.tables import composites as composites_table
from twin_server.persist.tables import deliveries as deliveries_table
from twin_server.persist.tables import diagnoses as diagnoses_table
from twin_server.persist.tables import fatigue as fatigue_table
from twin_server.persist.tables import ledger as ledger_table
from twin_server.persist.tables import outlooks as outlooks_table
from twin_server.persist.tables.checksums import (
    COMPOSITES,
    DELIVERIES,
    DIAGNOSES,
    FATIGUE,
    OUTLOOKS,
)
from twin_server.persist.tables.composites import CompositeRow
from twin_server.persist.tables.counted import count_of
from twin_server.persist.tables.diagnoses import DiagnosisRow
from twin_server.persist.tables.statements import Connection, last_number, note_number

from .quarantine import QuarantineTable


class SqlRecords(QuarantineTable):
    """Diagnoses, deliveries, composites, reported events, fatigue, outlooks, the ledger."""

    def add_diagnosis(self, row: DiagnosisRow, kept: int) -> int:
        """Keep a diagnosis that was asked for, and the last `kept` of its twin; its number."""
        with self._chaining() as (writer, journal):
            new = diagnoses_table.insert(writer, row)
            journal.put(DIAGNOSES, [new])
            gone = diagnoses_table.forget(writer, row.twin, kept)
            journal.remove(
                DIAGNOSES, (of_key(DIAGNOSES, number=n, twin=row.twin) for n in gone)
            )
            return count_of(new[0])

    def end_diagnosis(self, row: DiagnosisRow, page: bytes = b"", model: str = "") -> None:
        """Store the outcome of a diagnosis."""
        with self._chaining() as (writer, journal):
            journal.put(DIAGNOSES, diagnoses_table.update(writer, row, page, model))

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
        states: Sequence[DeliveryState] = (),
        due_ns: int | None = None,
        limit: int = 100,
    ) -> list[Delivery]:
        """Read deliveries: those due first, or without `due_ns` the newest first."""
        with self._reading() as reader:
            return deliveries_table.select(reader, twin, receiver, states, due_ns, limit)

    def settle(self, settled: Sequence[Delivery], begun: Sequence[Delivery] = ()) -> None:
        """Store the outcome of open deliveries, and begin others."""
        with self._chaining() as (writer, journal):
            journal.put(DELIVERIES, deliveries_table.settle(writer, settled))
            journal.put(DELIVERIES, deliveries_table.insert(writer, begun))

    def tallies(self) -> list[DeliveryTally]:
        """Count deliveries by twin, receiver and state."""
        with self._reading() as reader:
            return deliveries_table.tallies(reader)

    def forget_deliveries(self, before_ns: int) -> None:
        """Drop those that ended before then."""
        with self._chaining() as (writer, journal):
            gone = deliveries_table.forget(writer, before_ns)
            journal.remove(
                DELIVERIES, (of_key(DELIVERIES, id=i, twin=twin) for i, twin in gone)
            )

    def acknowledgements(self, twin_id: str) -> dict[str, AlarmAcknowledgement]:
        """Read the acknowledgements of alarms of a twin."""
        with self._reading() as reader:
            return deliveries_table.acknowledged(reader, twin_id)

    def composites(self, composite: str | None = None) -> list[CompositeRow]:
        """Read the registrations of all composites, or of one, in order."""
        with self._reading() as reader:
            return composites_table.read(reader, composite)

    def add_composites(self, rows: Sequence[CompositeRow]) -> None:
        """Store registrations, all at once, under the next numbers."""
        with self._chaining() as (writer, journal):
            following = (last_number(writer, "composite") or 0) + 1
            journal.put(COMPOSITES, composites_table.insert(writer, rows, following))
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

    def entries_between(self, twin_id: str, begin: int, end: int) -> list[bytes]:
        """Read the packed entries of a chain from one index up to, without, another."""
        with self._reading() as reader:
            return ledger_table.entries_between(reader, twin_id, begin, end)

    @contextlib.contextmanager
    def snapshot(self) -> Iterator[Connection]:
        """Hold a connection that sees one moment of the database, for an audit."""
        with self._reading() as reader:
            yield reader

    def renew_basis(self) -> None:
        """Chain all rows as they stand now, in place of what was chained before."""
        with self._chaining() as (writer, journal):
            renew(writer, journal)

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
        with self._chaining() as (writer, journal):
            journal.put(FATIGUE, fatigue_table.insert(writer, rows))

    def fatigue(self, twin_id: str) -> list[fatigue_table.FatigueRow]:
        """Read the fatigue messages of a twin in the order of time."""
        with self._reading() as reader:
            return fatigue_table.select(reader, twin_id)

    def add_outlook(self, row: outlooks_table.OutlookRow, kept: int) -> None:
        """Keep an outlook, and the last `kept` of its twin."""
        with self._chaining() as (writer, journal):
            gone = outlooks_table.add(writer, row, kept)
            journal.put(OUTLOOKS, [row])
            journal.remove(OUTLOOKS, (of_key(OUTLOOKS, id=i, twin=row.twin) for i in gone))

    def outlooks(
        self, twin_id: str, until: int | None = None, limit: int | None = None
    ) -> list[outlooks_table.OutlookRow]:
        """Read the newest outlooks of a twin that were made up to a reading, in order."""
        with self._reading() as reader:
            return outlooks_table.select(reader, twin_id, until, limit)

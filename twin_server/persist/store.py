"""The interface of the store, which SQLite and PostgreSQL implement.

One thread writes, in cuts: all that follows from a batch becomes durable together, or not at
all. Any thread reads, and sees whole cuts only.
"""

import contextlib
import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, Protocol

from slowtime_schemas.answers.alarms import DeliveryState
from slowtime_services.ledger import Entry, Link
from twin_server.events.asset_events import AssetEventRow
from twin_server.events.deliveries import AlarmAcknowledgement, Delivery, DeliveryTally
from twin_server.history.buckets import Buckets
from twin_server.history.details import Bodies
from twin_server.history.states import States
from twin_server.persist.tables.rows import (
    DetailRow,
    EventRow,
    FeatureRow,
    RunRow,
    StateRow,
    TwinRow,
)

from .attempts import AttemptNote
from .tables.composites import CompositeRow
from .tables.diagnoses import DiagnosisRow
from .tables.fatigue import FatigueRow
from .tables.ledger import HeadRow
from .tables.outlooks import OutlookRow
from .tables.quarantine import AsideRow


@dataclasses.dataclass(slots=True)
class WriteBatch:
    """Rows that become durable in one transaction."""

    twins: list[TwinRow] = dataclasses.field(default_factory=list)
    runs: list[RunRow] = dataclasses.field(default_factory=list)
    features: list[FeatureRow] = dataclasses.field(default_factory=list)
    held: list[tuple[int, int, bytes]] = dataclasses.field(default_factory=list)
    released: list[tuple[int, int]] = dataclasses.field(default_factory=list)
    events: list[EventRow] = dataclasses.field(default_factory=list)
    details: list[DetailRow] = dataclasses.field(default_factory=list)
    deliveries: list[Delivery] = dataclasses.field(default_factory=list)
    """To be begun; one of an id that is there already is not begun again."""
    settled: list[Delivery] = dataclasses.field(default_factory=list)
    """What has become of some that were begun."""
    acknowledgements: list[AlarmAcknowledgement] = dataclasses.field(default_factory=list)
    asset_events: list[AssetEventRow] = dataclasses.field(default_factory=list)
    """Of an id that a twin has already, the first stays."""
    aside: list[AsideRow] = dataclasses.field(default_factory=list)
    """Messages that are set aside."""


class StoredHistory(NamedTuple):
    """Part of a twin's history: states, and to which boot each belongs."""

    states: States
    number: Sequence[int]
    """Of each state, the number of its boot."""
    boots: dict[int, tuple[str, str]]
    """Name and unit of slow time of each boot number."""
    bodies: Bodies = ()
    """Detail of each state; empty where none has any."""


class ThinnedHistory(NamedTuple):
    """Part of a history: some states, with statistics of all of them."""

    history: StoredHistory
    bands: Buckets | None
    """Of all states; None where all of them are in `history`."""


class Store(Protocol):
    """The memory of a twin server."""

    def twins(self) -> list[TwinRow]:
        """All twins, in the order of their registration."""
        ...

    def twin(self, twin_id: str) -> TwinRow | None:
        """One twin."""
        ...

    def runs(self) -> tuple[list[RunRow], int]:
        """All boots in order, and the number the next one gets."""
        ...

    def boot_number(self, twin_id: str, boot: str) -> int | None:
        """Return the number of a boot of a twin; None where it has none of that name."""
        ...

    def held(self) -> list[tuple[int, int, bytes]]:
        """Boot number, sequence and bytes of all features kept until their turn."""
        ...

    def write(self, cut: WriteBatch) -> list[int]:
        """Make `cut` durable; give the numbers of its events."""
        ...

    def messages(self, twin_id: str, after: tuple[int, int], limit: int) -> list[FeatureRow]:
        """Read the next features of a twin, in order, after (boot number, sequence)."""
        ...

    def messages_of_boot(self, number: int, first: int, last: int) -> list[FeatureRow]:
        """Read the features `first` to `last` of the boot of a number, in order."""
        ...

    def rewrite(
        self,
        twin_id: str,
        states: Iterable[StateRow],
        finish: Callable[[], tuple[TwinRow, Sequence[EventRow]]],
    ) -> None:
        """Replace a twin's states, its registration and its derived events, all at once.

        Parameters
        ----------
        states
            Boot number, sequence and new state of each of its features.
        finish
            Asked for the rest once `states` are used up.
        """
        ...

    def delete(self, twin_id: str) -> bool:
        """Forget a twin and all it has seen; False where there is none."""
        ...

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
        """States between two times, both included, or after (boot number, sequence), in order.

        Parameters
        ----------
        limit, newest
            At most so many: the first, or with `newest` the last ones.
        """
        ...

    def thinned(
        self,
        twin_id: str,
        max_points: int,
        *,
        t_ns: tuple[int | None, int | None] = (None, None),
        slow_time: tuple[float | None, float | None] = (None, None),
    ) -> ThinnedHistory:
        """At most `max_points` states between two times, with statistics of all of them.

        It costs about the same whether there are a thousand states or a million.
        """
        ...

    def boots(self, twin_id: str) -> list[tuple[int, bytes, int]]:
        """Read number, first message and time of the last one of each boot with readings."""
        ...

    def neighbours(self, number: int, t_ns: int) -> tuple[bytes | None, bytes | None]:
        """Read the last message of a boot that ends by an instant, and the first one after."""
        ...

    def count(self, twin_id: str) -> int:
        """Count the features of a twin."""
        ...

    def digest(self, twin_id: str) -> tuple[str, int]:
        """SHA-256 over all features of a twin, their states and details, and their number."""
        ...

    def events(
        self,
        twin_id: str | None = None,
        *,
        after: int = 0,
        limit: int = 1000,
        newest: bool = False,
    ) -> list[EventRow]:
        """Events of one twin in order, or of all twins, one behind the other.

        Parameters
        ----------
        after
            Number of an event of the twin, which those that are wanted follow.
        """
        ...

    def add_diagnosis(self, row: DiagnosisRow, kept: int) -> int:
        """Keep a diagnosis that was asked for, and the last `kept` of its twin; its number."""
        ...

    def end_diagnosis(self, row: DiagnosisRow, page: bytes = b"", model: str = "") -> None:
        """Store the outcome of a diagnosis: its row, and its files if there are any."""
        ...

    def diagnoses(
        self, twin_id: str | None = None, number: int | None = None
    ) -> list[DiagnosisRow]:
        """Diagnoses in order: of a twin, or of all, or the one of a number of a twin."""
        ...

    def diagnosis_page(self, twin_id: str, number: int) -> bytes | None:
        """HTML of a diagnosis; None where it has none."""
        ...

    def diagnosis_model(self, twin_id: str, number: int) -> str | None:
        """Augmented model file of a diagnosis; None where it has none."""
        ...

    def deliveries(
        self,
        *,
        twin: str | None = None,
        receiver: str | None = None,
        states: Sequence[DeliveryState] = (),
        due_ns: int | None = None,
        limit: int = 100,
    ) -> list[Delivery]:
        """Deliveries of these states, due by then, those due first first.

        Of a twin, without `due_ns`, the newest first.
        """
        ...

    def settle(self, settled: Sequence[Delivery], begun: Sequence[Delivery] = ()) -> None:
        """Store the outcome of open deliveries, and begin others."""
        ...

    def tallies(self) -> list[DeliveryTally]:
        """Count deliveries by twin, receiver and state."""
        ...

    def forget_deliveries(self, before_ns: int) -> None:
        """Drop those that ended before then."""
        ...

    def acknowledgements(self, twin_id: str) -> dict[str, AlarmAcknowledgement]:
        """Read the acknowledged alarms of a twin, by the identity of the event."""
        ...

    def composites(self, composite: str | None = None) -> list[CompositeRow]:
        """Read the registrations of composites, or of one, in order."""
        ...

    def add_composites(self, rows: Sequence[CompositeRow]) -> None:
        """Store registrations, all at once, under the next numbers."""
        ...

    def asset_events(self, twin_id: str) -> list[AssetEventRow]:
        """Read the reported events of an asset, in the order of acceptance."""
        ...

    def ends(self) -> dict[str, Link]:
        """End of the chain of each twin, of deleted ones as well."""
        ...

    def entries(self, twin_id: str, after: int) -> list[Entry]:
        """Entries of a twin's chain behind so many, which end a block."""
        ...

    def entries_between(self, twin_id: str, begin: int, end: int) -> list[bytes]:
        """Read the packed entries of a chain from one index up to, without, another."""
        ...

    def seal_with(self, seal: Callable[[bytes], bytes] | None) -> None:
        """Seal what is chained from now on with the server's key; None: do not seal."""
        ...

    def renew_basis(self) -> None:
        """Chain all rows as they stand now, in place of what was chained before."""
        ...

    def snapshot(self) -> contextlib.AbstractContextManager[Any]:
        """Hold a connection that sees one moment of the database, for an audit."""
        ...

    def add_head(self, row: HeadRow) -> None:
        """Keep a signed head."""
        ...

    def heads(
        self, *, after: int = 0, limit: int = 1000, newest: bool = False
    ) -> list[HeadRow]:
        """Signed heads in order: those after a number, of which the first or the last ones."""
        ...

    def add_fatigue(self, rows: Sequence[FatigueRow]) -> None:
        """Keep fatigue messages; of a boot and hour the newest stays."""
        ...

    def fatigue(self, twin_id: str) -> list[FatigueRow]:
        """Fatigue messages of a twin in the order of time."""
        ...

    def add_outlook(self, row: OutlookRow, kept: int) -> None:
        """Keep an outlook, and the last `kept` of its twin."""
        ...

    def outlooks(
        self, twin_id: str, until: int | None = None, limit: int | None = None
    ) -> list[OutlookRow]:
        """Read the newest outlooks of a twin that were made up to a reading, in order.

        Parameters
        ----------
        until
            Id of the reading; None for the last.
        limit
            At most so many.
        """
        ...

    def set_aside(self, rows: Sequence[AsideRow]) -> None:
        """Keep messages that are set aside; one that is kept already is not kept again."""
        ...

    def aside(self, twin_id: str | None = None, number: int | None = None) -> list[AsideRow]:
        """Read the messages that were set aside: of a twin, of a number, or all, in order."""
        ...

    def release_aside(self, number: int) -> None:
        """Forget a message that is no longer aside."""
        ...

    def drop_aside(self, row: AsideRow) -> None:
        """Delete a message; its place in the history stays without an estimate."""
        ...

    @property
    def attempts(self) -> AttemptNote:
        """Note of what the server is about to do."""
        ...

    def check(self) -> None:
        """Raise where nothing can be written or read any more."""
        ...

    def close(self) -> None:
        """Leave."""
        ...

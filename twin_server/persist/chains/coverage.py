"""How the ledger covers each table of the layout.

A row of a table in `COVERED` has an entry in the chain of its owner each time it is written or
removed, so that the last entry of a key says what the row has to be. What is in `FOLLOWING` has
no entries of its own, for the reason beside it.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from slowtime_services.ledger import Entry, key_of, row_digest
from slowtime_services.ledger import chain as kinds
from slowtime_services.ledger.chain import GONE
from twin_server.persist.tables.checksums import (
    ACKNOWLEDGEMENTS,
    ASSET_EVENTS,
    COMPOSITES,
    DELIVERIES,
    DIAGNOSES,
    DIGESTS,
    EVENTS,
    FATIGUE,
    HELD,
    OUTLOOKS,
    QUARANTINE,
    RUNS,
    TWINS,
    SqlTable,
)
from twin_server.persist.tables.counted import count_of
from twin_server.persist.tables.search import SHIFT

Row = Sequence[Any]

COMPOSITE = "composite:"
"""Begins the name of a composite's chain; no twin's id has a colon."""
SERVER = "server:"
"""Chain of rows that belong to no twin, such as a message that tries a receiver."""

NUMBERED = frozenset(table.name for table in (EVENTS, DIAGNOSES, COMPOSITES, RUNS, QUARANTINE))
"""Tables whose rows are named by their number."""


class Coverage(NamedTuple):
    """How the rows of one table are chained.

    Parameters
    ----------
    kind
        Letter of their entries.
    owner
        Name of the chain of a row, or the number of the boot whose twin it is.
    owned
        The same as a condition in SQL, with one parameter: the owner. None where rows are
        found by the ids of the features of a boot (`id`, or `number` of the boot).
    keys
        Columns of the key.
    is_appended
        Whether a row is never written again: a second entry of its key is a forgery.
    """

    table: SqlTable
    kind: str
    owner: Callable[[Row], str | int]
    owned: str | None
    keys: tuple[str, ...]
    is_appended: bool = False

    def key(self, row: Row) -> int:
        """Return the key of a row's entries: its number, or a hash of its key."""
        at = self.table.columns.index
        words = [row[at(name)] for name in self.keys]
        return words[0] if isinstance(words[0], int) and len(words) == 1 else key_of(*words)

    def written(self, row: Row) -> Entry:
        """Return the entry of a row as it is kept, without checksums."""
        return Entry(self.kind, self.key(row), row_digest(self.kind, row))

    def removed(self, row: Row) -> Entry:
        """Return the entry of a row that is removed."""
        return Entry(self.kind, self.key(row), GONE)

    def name(self, row: Row) -> str:
        """Name a row to people."""
        at = self.table.columns.index
        shown = [row[at(name)] for name in self.keys]
        if self.table.name in NUMBERED:
            shown = [count_of(shown[0])]  # above it is the place of the twin
        words = ", ".join(f"{k} {v!s:.60}" for k, v in zip(self.keys, shown, strict=True))
        return f"the row of {self.table.name} with {words}"

    def name_of_missing(self, key: int) -> str:
        """Name a row that is not there, as far as its key tells."""
        if self.table.name in NUMBERED:
            return f"the row of {self.table.name} with number {count_of(key)}"
        return f"a row of {self.table.name} (key {key:014x})"


def _column(table: SqlTable, name: str) -> Callable[[Row], Any]:
    at = table.columns.index(name)
    return lambda row: row[at]


def _of_twin(
    table: SqlTable, kind: str, *keys: str, column: str = "twin", is_appended: bool = False
) -> Coverage:
    named = _column(table, column)
    return Coverage(
        table, kind, lambda row: named(row) or SERVER, f"{column} = ?", keys, is_appended
    )


COVERED: dict[str, Coverage] = {
    one.table.name: one
    for one in (
        _of_twin(TWINS, "t", "id", column="id"),
        _of_twin(RUNS, "u", "number"),
        Coverage(HELD, "h", lambda row: int(row[0]), None, ("number", "sequence")),
        Coverage(DIGESTS, "k", lambda row: int(row[0]) >> SHIFT, None, ("id",)),
        _of_twin(EVENTS, "n", "number", is_appended=True),
        _of_twin(DIAGNOSES, "g", "number"),
        _of_twin(DELIVERIES, "o", "id"),
        _of_twin(ACKNOWLEDGEMENTS, kinds.ACKNOWLEDGEMENT, "event", is_appended=True),
        _of_twin(ASSET_EVENTS, kinds.ASSET_EVENT, "event", is_appended=True),
        Coverage(
            COMPOSITES,
            "c",
            lambda row: f"{COMPOSITE}{row[1]}",
            "composite = ?",
            ("number",),
            is_appended=True,
        ),
        _of_twin(QUARANTINE, "q", "number"),
        _of_twin(FATIGUE, "y", "boot", "hour"),
        _of_twin(OUTLOOKS, "w", "id"),
    )
}
"""Tables whose rows have entries, by their names."""

OF_KIND = {one.kind: one for one in COVERED.values()}

FOLLOWING: dict[str, str] = {
    "features": "each has an entry of its own kind, without its state; see details",
    "details": "states and details have one entry for each boot and transaction",
    "levels": "buckets follow from the states, and are computed again by an audit",
    "ledger": "the chains themselves: every block is hashed with the one before",
    "heads": "each is signed and contains the hash of the one before",
    "numbers": "counters that nobody is shown; an audit finds one below a number given",
}
"""Tables without entries of rows, and why they are covered all the same."""

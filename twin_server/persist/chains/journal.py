"""Entries of one transaction, by chain; what was written is known, not read back.

Rows that are read back could have been changed behind the server's back, and an entry made of
them would vouch for that.
"""

from collections.abc import Iterable, Mapping, Sequence

from slowtime_services.ledger import Entry, states_digest
from slowtime_services.ledger import chain as kinds
from twin_server.persist.tables.checksums import SqlTable
from twin_server.persist.tables.statements import Connection

from .coverage import COVERED, SERVER, Row


class Journal:
    """Collects the entries of the rows that a transaction writes and removes."""

    def __init__(self, writer: Connection) -> None:
        self._writer = writer
        self._twins: dict[int, str] = {}
        self.entries: dict[str, list[Entry]] = {}

    def know_boots(self, twins: Mapping[int, str]) -> None:
        """Tell the twin of some boots, by their numbers."""
        self._twins.update(twins)

    def add(self, owner: str, entries: Iterable[Entry]) -> None:
        """Take entries of other kinds than rows."""
        self.entries.setdefault(owner, []).extend(entries)

    def put(self, table: SqlTable, rows: Iterable[Row]) -> None:
        """Note rows that were written, without their checksums."""
        coverage = COVERED[table.name]
        for row in rows:
            self.add(self.owner(coverage.owner(row)), [coverage.written(row)])

    def remove(self, table: SqlTable, rows: Iterable[Row]) -> None:
        """Note rows that were removed; of each the owner and the key are needed only."""
        coverage = COVERED[table.name]
        for row in rows:
            self.add(self.owner(coverage.owner(row)), [coverage.removed(row)])

    def put_states(self, twin_id: str, rows: Sequence[tuple[int, bytes, bytes, bytes]]) -> None:
        """Note states of consecutive features of one boot (see `states_digest`)."""
        if rows:
            self.add(twin_id, [Entry(kinds.STATES, rows[0][0], states_digest(rows))])

    def owner(self, given: str | int) -> str:
        """Return the name of a chain, given as it is or as the number of a boot."""
        if isinstance(given, str):
            return given
        if given not in self._twins:
            row = self._writer.execute(
                "select twin from runs where number = ?", (given,)
            ).fetchone()
            self._twins[given] = SERVER if row is None else row[0]
        return self._twins[given]


def of_key(table: SqlTable, **keys: object) -> tuple[object, ...]:
    """Return a row of which only some columns are known, to note that it was removed.

    Examples
    --------
    >>> from twin_server.persist.tables.checksums import HELD
    >>> of_key(HELD, number=3, sequence=7)
    (3, 7, None)
    """
    return tuple(keys.get(name) for name in table.columns)

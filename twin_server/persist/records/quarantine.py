"""The part of the store that keeps messages that were set aside."""

from collections.abc import Sequence

from twin_server.persist.tables import quarantine as table
from twin_server.persist.tables.checksums import QUARANTINE
from twin_server.persist.tables.quarantine import AsideRow

from .base import SqlBase


class QuarantineTable(SqlBase):
    """Messages that were set aside, of a store."""

    def set_aside(self, rows: Sequence[AsideRow]) -> None:
        """Keep messages that are set aside; one that is kept already is not kept again."""
        with self._chaining() as (writer, journal):
            journal.put(QUARANTINE, table.add(writer, rows))

    def aside(self, twin_id: str | None = None, number: int | None = None) -> list[AsideRow]:
        """Read the messages that were set aside: of a twin, of a number, or all, in order."""
        with self._reading() as reader:
            return table.read(reader, twin_id, number)

    def release_aside(self, number: int) -> None:
        """Forget a message that is no longer aside."""
        with self._chaining() as (writer, journal):
            journal.remove(QUARANTINE, table.remove(writer, number))

    def drop_aside(self, row: AsideRow) -> None:
        """Delete a message; its place in the history stays without an estimate."""
        with self._chaining() as (writer, journal):
            journal.remove(QUARANTINE, table.remove(writer, row.number))
            journal.put(QUARANTINE, table.keep_place(writer, row))

"""The part of the store that keeps messages that were set aside."""

import abc
import contextlib
from collections.abc import Sequence

from .tables import quarantine as table
from .tables.quarantine import AsideRow
from .tables.statements import Connection


class QuarantineTable(abc.ABC):
    """Messages that were set aside, of a store."""

    @abc.abstractmethod
    def _writing(self) -> contextlib.AbstractContextManager[Connection]:
        """Hold the writer in a transaction; within another one, a part of that."""

    @abc.abstractmethod
    def _reading(self) -> contextlib.AbstractContextManager[Connection]:
        """Hold a connection that sees one snapshot of the database."""

    def set_aside(self, rows: Sequence[AsideRow]) -> None:
        """Keep messages that are set aside; one that is kept already is not kept again."""
        with self._writing() as writer:
            table.add(writer, rows)

    def aside(self, twin_id: str | None = None, number: int | None = None) -> list[AsideRow]:
        """Read the messages that were set aside: of a twin, of a number, or all, in order."""
        with self._reading() as reader:
            return table.read(reader, twin_id, number)

    def release_aside(self, number: int) -> None:
        """Forget a message that is no longer aside."""
        with self._writing() as writer:
            table.remove(writer, number)

    def drop_aside(self, row: AsideRow) -> None:
        """Delete a message; its place in the history stays without an estimate."""
        with self._writing() as writer:
            table.drop(writer, row)

"""What the parts of the store share: connections, and the journal of a transaction."""

import abc
import contextlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from twin_server.persist.chains import Journal
from twin_server.persist.history_hashes import HistoryHashes
from twin_server.persist.tables import ledger as ledger_table
from twin_server.persist.tables.checksums import SqlTable
from twin_server.persist.tables.statements import Connection, select
from twin_server.persist.tables.twins import RunWriter


class SqlBase(abc.ABC):
    """Connections and ledger of a store."""

    def __init__(self) -> None:
        self._hashes = HistoryHashes()
        self._ends = ledger_table.ChainEnds()
        self._runs = RunWriter()
        self._journal: Journal | None = None

    @abc.abstractmethod
    def _writing(self) -> contextlib.AbstractContextManager[Connection]:
        """Hold the writer in a transaction; within another one, a part of that."""

    @abc.abstractmethod
    def _reading(self) -> contextlib.AbstractContextManager[Connection]:
        """Hold a connection that sees one snapshot of the database."""

    @contextlib.contextmanager
    def _chaining(self) -> Iterator[tuple[Connection, Journal]]:
        """Write rows; what is noted in the journal is chained in the same transaction."""
        try:
            with self._writing() as writer:
                if self._journal is not None:  # within another one: that chains both
                    yield writer, self._journal
                    return
                self._journal = Journal(writer)
                try:
                    yield writer, self._journal
                    self._ends.append(writer, self._journal.entries)
                finally:
                    self._journal = None
        except BaseException:
            # The last write may not have become durable.
            self._ends.forget()
            self._runs.forget()
            raise

    def seal_with(self, seal: Callable[[bytes], bytes] | None) -> None:
        """Seal what is chained from now on with the server's key; None: do not seal."""
        self._ends.seal = seal

    def _all(
        self, table: SqlTable, where: str = "", parameters: Sequence[Any] = ()
    ) -> list[Any]:
        with self._reading() as reader:
            return select(reader, table, where, parameters)

"""Hashes of the histories of all twins, kept in memory and rolled on as rows are appended."""

import contextlib
import threading
from collections.abc import Iterator, Sequence

from .chains import Journal
from .chains.journal import of_key
from .tables.checksums import DIGESTS
from .tables.digests import HashedRow, RollingHash, insert_digests, rolled
from .tables.levels import GrownBoot
from .tables.rows import DetailRow, FeatureRow
from .tables.search import SHIFT, Span, whole
from .tables.statements import Connection
from .tables.twins import WrittenBoot


class HistoryHashes:
    """Hashes of histories as they are now, of each twin that was written or asked about."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._found: dict[str, RollingHash] = {}
        self._being_made: set[str] = set()
        self._times_made: dict[str, int] = {}

    def adopt(self, found: dict[str, RollingHash]) -> None:
        """Start from hashes computed while the database was checked."""
        with self._lock:
            self._found.update(found)

    def known(self, twin_id: str) -> RollingHash | None:
        """Return a hash to roll on, where there is one."""
        with self._lock:
            found = self._found.get(twin_id)
            return None if found is None else found.copy()

    def lose(self, twin_id: str) -> None:
        """Drop the hash of a history until `settle`, because its rows are about to change."""
        with self._lock:
            self._found.pop(twin_id, None)
            self._being_made.add(twin_id)

    def settle(self, news: dict[str, RollingHash | None]) -> None:
        """Take over hashes of rows that have become durable."""
        with self._lock:
            for twin_id, rolling in news.items():
                if rolling is not None:
                    self._found[twin_id] = rolling
                else:
                    self._forget(twin_id)

    @contextlib.contextmanager
    def remade(self, twin_id: str) -> Iterator[None]:
        """Drop the hash of a history while it is rewritten, and that of its predecessor."""
        self.lose(twin_id)
        try:
            yield
        finally:
            with self._lock:
                self._forget(twin_id)

    def _forget(self, twin_id: str) -> None:
        self._found.pop(twin_id, None)
        self._times_made[twin_id] = self._times_made.get(twin_id, 0) + 1
        self._being_made.discard(twin_id)

    def begun(self, twin_id: str) -> tuple[RollingHash, int | None]:
        """Return the known hash of a history, and the token to `offer` a longer one with."""
        with self._lock:
            if twin_id in self._being_made:
                return RollingHash(), None
            found = self._found.get(twin_id)
            made = self._times_made.get(twin_id, 0)
            return (RollingHash() if found is None else found.copy()), made

    def offer(self, twin_id: str, rolling: RollingHash, made: int | None) -> None:
        """Keep a hash for the next request, unless the history was rewritten meanwhile."""
        with self._lock:
            before = self._found.get(twin_id)
            if (
                made is not None
                and made == self._times_made.get(twin_id, 0)
                and twin_id not in self._being_made
                and (before is None or before.count < rolling.count)
            ):
                self._found[twin_id] = rolling

    def roll(
        self,
        writer: Connection,
        features: Sequence[FeatureRow],
        details: Sequence[DetailRow],
        written: Sequence[WrittenBoot],
        news: dict[str, RollingHash | None],
        journal: Journal,
    ) -> None:
        """Roll on the hashes of the histories that new features make longer, and keep some.

        Of a history in which rows were put before others there is none in `news`.
        """
        bodies = {(d.number, d.sequence): d.body for d in details}
        of_run: dict[int, list[HashedRow]] = {}
        for n, s, _, _, message, state in features:
            row = HashedRow(n << SHIFT | s, message, state, bodies.get((n, s)))
            of_run.setdefault(n, []).append(row)
        kept: list[tuple[int, int, str]] = []
        for twin_id, boot, grown in written:
            if grown.number not in of_run:
                continue
            rows = of_run[grown.number]
            rolling = news[twin_id] if twin_id in news else self.known(twin_id)
            spans = [] if rolling is not None else whole(writer, twin_id)
            if rolling is None and not _has_rows_before(spans, grown):
                rolling = RollingHash()
            if rolling is not None and rolling.last < rows[0].key:
                kept += rolled(rolling, rows, boot)
                news[twin_id] = rolling
                continue
            news[twin_id] = None
            self.lose(twin_id)
            for span in spans or whole(writer, twin_id):
                # What follows a row that was put before it has another hash now.
                since = max(span.first, rows[0].key)
                where, asked = "where id between ? and ?", (since, span.last)
                gone = writer.execute(f"select id from digests {where}", asked).fetchall()
                writer.execute(f"delete from digests {where}", asked)
                journal.remove(DIGESTS, (of_key(DIGESTS, id=row[0]) for row in gone))
        insert_digests(writer, kept)
        journal.put(DIGESTS, kept)


def _has_rows_before(spans: Sequence[Span], grown: GrownBoot) -> bool:
    return grown.before >= 0 or any(
        span.last >= span.first for span in spans if span.number != grown.number
    )

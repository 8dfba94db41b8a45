"""Hashes of histories that are rolled on as rows are appended, so that each costs one step.

SHA-256 over all features of a twin, their states and details, in order. Every so many rows it
is also kept, which ties each row to all before it: `slowtime db check`, and a server that
starts, roll it anew and compare.
"""

import hashlib
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from .checksums import DIGESTS, RUNS, opened
from .search import SHIFT

KEPT_EVERY_BITS = 9
"""Binary logarithm of how many sequences of a boot lie between two hashes that are kept."""

_LOW = (1 << SHIFT) - 1


class HashedRow(NamedTuple):
    """Hashed content of one feature."""

    key: int
    message: bytes
    state: bytes
    body: bytes | None


class RollingHash:
    """Hash of a history up to the row of the key `last`."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self.count, self.last = 0, -1

    def copy(self) -> "RollingHash":
        """Return an independent copy."""
        other = RollingHash()
        other._hash, other.count, other.last = self._hash.copy(), self.count, self.last
        return other

    def take(self, row: HashedRow, boot: str) -> None:
        """Take the next row in."""
        head = f"{boot} {row.key & _LOW} {len(row.message)} {len(row.state)}\n"
        self._hash.update(head.encode() + row.message + row.state + (row.body or b""))
        self.count, self.last = self.count + 1, row.key

    @property
    def hexadecimal(self) -> str:
        """SHA-256 so far."""
        return self._hash.hexdigest()


def rolled(
    rolling: RollingHash, rows: Iterable[HashedRow], boot: str
) -> Iterator[tuple[int, int, str]]:
    """Take rows of a boot in; give last key, count and hash of each that is to be kept."""
    for row in rows:
        before = rolling.last
        if before >= 0 and row.key >> KEPT_EVERY_BITS != before >> KEPT_EVERY_BITS:
            yield before, rolling.count, rolling.hexadecimal
        rolling.take(row, boot)


def insert_digests(writer: Any, rows: Iterable[tuple[int, int, str]]) -> None:
    """Keep hashes."""
    writer.executemany(
        "insert into digests (id, count, sha256, crc) values (?,?,?,?)",
        [DIGESTS.sealed(row) for row in rows],
    )


class HistoryHasher:
    """Rolls the hashes of all twins in one pass over all features, beside another's purpose.

    Parameters
    ----------
    reader
        Of the same moment as the features that are given to `take`.
    """

    def __init__(self, reader: Any) -> None:
        runs = opened(RUNS, reader.execute(f"select {', '.join(RUNS.all_columns)} from runs"))
        at = RUNS.columns.index
        self._runs = {run[at("number")]: (run[at("twin")], run[at("boot")]) for run in runs}
        kept = reader.execute(f"select {', '.join(DIGESTS.all_columns)} from digests")
        self._kept = {key: told for key, *told in opened(DIGESTS, kept)}
        self._details = iter(reader.execute("select id, body from details order by id"))
        self._detail: tuple[int, bytes] | None = next(self._details, None)
        self.found: dict[str, RollingHash] = {}
        self.wrong: list[str] = []

    def take(self, key: int, message: bytes, state: bytes) -> None:
        """Take the next row in; they come in the order of their keys."""
        while self._detail is not None and self._detail[0] < key:
            self._detail = next(self._details, None)
        here = self._detail is not None and self._detail[0] == key
        run = self._runs.get(key >> SHIFT)
        if run is None:
            return
        rolling = self.found.setdefault(run[0], RollingHash())
        body = self._detail[1] if here and self._detail is not None else None
        rolling.take(HashedRow(key, message, state, body), run[1])
        kept = self._kept.get(key)
        if kept is not None and kept != [rolling.count, rolling.hexadecimal]:
            self.wrong.append(
                f"the history of {run[0]} up to feature {key & _LOW} of boot {run[1]} is not "
                "the one that was hashed"
            )

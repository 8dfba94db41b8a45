"""Tables of the ledger: each accepted row is chained to the one before it.

A block holds the entries of one twin and one cut, so that a cut of thousands of rows costs one
row more. Chains and heads are described in `slowtime_services.ledger`.
"""

import hashlib
import itertools
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from slowtime_services.ledger import (
    Entry,
    Link,
    beginning,
    features_digest,
    followed,
    packed,
    unpacked,
)
from slowtime_services.ledger import chain as kinds
from slowtime_services.ledger.chain import WIDTH, words_digest

from .checksums import FEATURES, HEADS, LEDGER, TWINS, opened
from .search import SHIFT, whole

logger = logging.getLogger(__name__)

_LOW = (1 << SHIFT) - 1
_AT_ONCE = 2_000
"""Entries of one block at most, and rows that are chained at once while a ledger is built."""

_NOTHING = hashlib.sha256().digest()


class HeadRow(NamedTuple):
    """A stored signed head: its JSON, and that of the leaves that had changed."""

    number: int
    t_ns: int
    body: str


class ChainEnds:
    """ChainEnds of all chains as they are in the database, read once and then remembered."""

    def __init__(self) -> None:
        self._known: dict[str, Link] = {}
        self._whole = False
        self.seal: Callable[[bytes], bytes] | None = None
        """Authentication code of the server's key, where it has one that may sign."""

    def forget(self) -> None:
        """Drop all ends: the last write may not have become durable."""
        self._known.clear()
        self._whole = False

    def append(self, writer: Any, entries: Mapping[str, Sequence[Entry]]) -> None:
        """Chain entries to those of their twins; the blocks of all are one statement."""
        blocks: list[tuple[str, int, bytes, bytes]] = []
        for twin_id, theirs in entries.items():
            if not theirs:  # a chain begins with its first entry
                continue
            end = self._known.get(twin_id) or _end(writer, twin_id)
            for first in range(0, len(theirs), _AT_ONCE):
                block = packed(theirs[first : first + _AT_ONCE])
                end = followed(end, block)
                if self.seal is not None:
                    seal = Entry(kinds.SEAL, 0, self.seal(end.digest)).written
                    block, end = block + seal, followed(end, seal)
                blocks.append((twin_id, end.length, block, end.digest))
            self._known[twin_id] = end
        insert_blocks(writer, blocks)

    def all(self, reader: Any) -> dict[str, Link]:
        """Return the ends of all chains, those of deleted twins among them."""
        if not self._whole:
            self._known = {twin_id: _end(reader, twin_id) for twin_id in _chained(reader)}
            self._whole = True
        return dict(self._known)


def of_features(rows: Iterable[tuple[int, int, float, bytes]], boot: str) -> Iterator[Entry]:
    """Return the entries of features of a boot: of ids, sensor times, slow times, messages."""
    for key, t_ns, slow_time, message in rows:
        digest = features_digest(boot, key & _LOW, t_ns, float(slow_time), message)
        yield Entry(kinds.FEATURES, key, digest)


def of_registration(registration: str) -> Entry:
    """Return the entry of a registration as it is kept."""
    return Entry(kinds.REGISTRATION, 0, words_digest("r", registration))


def of_act(kind: str) -> Entry:
    """Return the entry of an operation on all of a twin."""
    return Entry(kind, 0, _NOTHING)


def insert_blocks(writer: Any, rows: Iterable[tuple[str, int, bytes, bytes]]) -> None:
    """Keep some blocks."""
    names = LEDGER.all_columns
    writer.executemany(
        f"insert into ledger ({', '.join(names)}) values ({','.join('?' * len(names))})",
        [LEDGER.sealed(row) for row in rows],
    )


def entries(reader: Any, twin_id: str, after: int) -> list[Entry]:
    """Read the entries of a twin's chain behind so many, which end a block."""
    rows = reader.execute(
        f"select {', '.join(LEDGER.all_columns)} from ledger where twin = ? and count > ? "
        "order by count",
        (twin_id, after),
    )
    return [entry for row in opened(LEDGER, rows) for entry in unpacked(row[2])]


def entries_between(reader: Any, twin_id: str, begin: int, end: int) -> list[bytes]:
    """Read the packed entries of a chain from one index up to, without, another."""
    rows = reader.execute(
        f"select {', '.join(LEDGER.all_columns)} from ledger where twin = ? and count > ? "
        "and count <= ? order by count",
        (twin_id, begin, end + _AT_ONCE),  # the last block may end so much later, by its seal
    )
    found: list[bytes] = []
    for row in rows:
        [(_, count, block, _)] = opened(LEDGER, [row])
        at = count - len(block) // WIDTH
        first, past = max(begin - at, 0), min(end, count) - at
        found += (block[n * WIDTH : (n + 1) * WIDTH] for n in range(first, past))
        if count >= end:
            break
    return found


def insert_head(writer: Any, row: HeadRow) -> None:
    """Keep a head."""
    names = HEADS.all_columns
    writer.execute(
        f"insert into heads ({', '.join(names)}) values ({','.join('?' * len(names))})",
        HEADS.sealed(row),
    )


def heads(reader: Any, after: int, limit: int, newest: bool) -> list[HeadRow]:
    """Read heads in order: those after a number, of which the first or the last ones."""
    rows = reader.execute(
        f"select {', '.join(HEADS.all_columns)} from heads where number > ? "
        f"order by number {'desc' if newest else ''} limit ?",
        (after, limit),
    )
    found = [HeadRow(*row) for row in opened(HEADS, rows)]
    return found[::-1] if newest else found


def build_ledger(writer: Any, tell: Callable[[str], None] = logger.info) -> None:
    """Chain the rows of a database of an older version."""
    twins = opened(TWINS, writer.execute(f"select {', '.join(TWINS.all_columns)} from twins"))
    if twins:
        tell(f"The histories of {len(twins)} twins are chained into a ledger, once.")
    ends = ChainEnds()
    for row in twins:
        twin_id, registration = row[0], row[TWINS.columns.index("registration")]
        ends.append(writer, {twin_id: [of_registration(registration)]})
        for span in whole(writer, twin_id):
            found = writer.execute(
                f"select {', '.join(FEATURES.all_columns)} from features "
                "where id between ? and ? order by id",
                (span.first, span.last),
            )
            rows = iter(found.fetchall())
            while part := opened(FEATURES, itertools.islice(rows, _AT_ONCE)):
                entries = list(of_features((row[:4] for row in part), span.boot))
                ends.append(writer, {twin_id: entries})


def _end(reader: Any, twin_id: str) -> Link:
    rows = reader.execute(
        f"select {', '.join(LEDGER.all_columns)} from ledger where twin = ? "
        "order by count desc limit 1",
        (twin_id,),
    )
    found = opened(LEDGER, rows)
    return Link(found[0][1], found[0][3]) if found else beginning(twin_id)


def _chained(reader: Any) -> Iterator[str]:
    """Return all twins with a chain, by one index look-up each."""
    last = ""
    while row := reader.execute(
        "select twin from ledger where twin > ? order by twin, count limit 1", (last,)
    ).fetchone():
        last = row[0]
        yield last

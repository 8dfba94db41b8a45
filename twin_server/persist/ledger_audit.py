"""Compares a database with its ledger, and finds rows changed, inserted, deleted or moved.

Checksums of rows detect decay, but a forger can recompute them. The forger cannot sign a head,
because the key is not in the database. Rows accepted after the last head are not covered yet.
"""

import dataclasses
import itertools
import json
from collections.abc import Callable, Iterator
from typing import Any

from slowtime_services.ledger import (
    Entry,
    Head,
    Leaf,
    Link,
    MerkleTree,
    beginning,
    features_digest,
    followed,
    follows,
    unpacked,
)
from slowtime_services.ledger import chain as kinds
from slowtime_services.ledger.chain import WIDTH

from .tables import asset_events as asset_events_table
from .tables.checksums import ACKNOWLEDGEMENTS, LEDGER, TWINS, opened
from .tables.digests import HashedRow, RollingHash
from .tables.ledger import heads as heads_after
from .tables.ledger import of_acknowledgement, of_asset_event, of_registration
from .tables.search import SHIFT, Span, whole

_FEATURES, _ANEW, _DELETED = (
    kind.encode() for kind in (kinds.FEATURES, kinds.ANEW, kinds.DELETED)
)
_LOW = (1 << SHIFT) - 1
_AT_ONCE = 1_000
"""Rows that are read at once."""


@dataclasses.dataclass
class Audit:
    """Result of comparing a database with its ledger.

    Parameters
    ----------
    wrong
        Differences from what was accepted, one sentence each; empty if there are none.
    heads
        How many signed heads there are, and the last one.
    vouched, waiting
        Number of entries that the last head covers, and of those after it.
    notes
        Checks that could not be made, and why.
    """

    wrong: list[str] = dataclasses.field(default_factory=list)
    heads: int = 0
    last: Head | None = None
    vouched: int = 0
    waiting: int = 0
    notes: list[str] = dataclasses.field(default_factory=list)


def audit(
    reader: Any,
    *,
    public: str | None = None,
    kept: Head | None = None,
    tell: Callable[[str, int], None] | None = None,
) -> Audit:
    """Compare all rows with the ledger, and the ledger with its heads.

    Parameters
    ----------
    reader
        Connection that sees one moment of the database.
    public
        Key of the server, from elsewhere; None to believe the one in the heads.
    kept
        A head that was kept elsewhere: the database has to have it.
    tell
        Told the name of each twin and how many entries its chain has.
    """
    found = Audit()
    standing, links = _heads(reader, found, public, kept)
    twins = {
        row[0]: row[TWINS.columns.index("registration")]
        for row in opened(
            TWINS, reader.execute(f"select {', '.join(TWINS.all_columns)} from twins")
        )
    }
    chained = {row[0] for row in reader.execute("select distinct twin from ledger").fetchall()}
    matched = 0
    for twin_id in sorted(twins.keys() | chained | standing.leaves.keys()):
        one = _Chain(reader, twin_id, standing.leaves.get(twin_id), links.get(twin_id, {}))
        matched += one.check(twins.get(twin_id), found)
        if tell is not None:
            tell(twin_id, one.end.length)
    features = reader.execute("select count(*) from features").fetchone()[0]
    if features != matched and not found.wrong:
        found.wrong.append(
            f"{features - matched} features are of no twin and no boot that was ever accepted"
        )
    if not found.heads:
        found.notes.append(
            "No head was ever signed here: give the server a key (`slowtime ledger key`)."
        )
    return found


def _heads(
    reader: Any, found: Audit, public: str | None, kept: Head | None
) -> tuple[MerkleTree, dict[str, dict[int, str]]]:
    """Check the chain of heads; return what the last one covers, and every end ever signed."""
    standing, links = MerkleTree(), dict[str, dict[int, str]]()
    number, seen = 0, False
    while rows := heads_after(reader, number, _AT_ONCE, newest=False):
        for row in rows:
            number = row.number
            try:
                told = json.loads(row.body)
                head = Head.of(told["head"])
                leaves = [Leaf(*leaf) for leaf in told["leaves"]]
            except (ValueError, KeyError, TypeError):
                found.wrong.append(f"head {row.number} cannot be read")
                return standing, links
            standing.take(leaves)
            if not _is_right(head, row, found, public, standing):
                return standing, links
            for leaf in leaves:
                links.setdefault(leaf.asset, {})[leaf.length] = leaf.link
            found.last, found.heads = head, found.heads + 1
            seen |= kept == head
    if kept is not None and not seen:
        there = f"ends at head {number}" if number < kept.number else "has another there"
        found.wrong.append(
            f"head {kept.number}, which was kept elsewhere, is not in the ledger, which {there}"
        )
    return standing, links


def _is_right(
    head: Head, row: Any, found: Audit, public: str | None, standing: MerkleTree
) -> bool:
    which = f"head {row.number}"
    if (head.number, head.t_ns) != (row.number, row.t_ns):
        found.wrong.append(f"{which} is another one than its row says")
    elif not head.is_signed or head.public != (public or head.public):
        found.wrong.append(f"{which} is not signed with the server's key")
    elif found.last is not None and head.public != found.last.public and public is None:
        found.wrong.append(
            f"{which} is signed with another key than those before; if the server was given a "
            "new one, name it"
        )
    elif not follows(head, found.last):
        found.wrong.append(f"{which} does not follow the one before: some are missing")
    elif (head.assets, head.root) != (len(standing.leaves), standing.root):
        found.wrong.append(f"{which} vouches for other chains than those that stand beside it")
    else:
        return True
    return False


class _Chain:
    """The chain of one twin, and the rows that are there of it."""

    def __init__(
        self, reader: Any, twin_id: str, leaf: Leaf | None, links: dict[int, str]
    ) -> None:
        self._reader, self._twin_id = reader, twin_id
        self._leaf, self._links = leaf, links
        self.end = beginning(twin_id)
        self._is_other = False
        """Whether rows came before others, or all was estimated anew, since the last head."""

    def check(self, registration: str | None, found: Audit) -> int:
        """Check one chain; return how many features were compared with their entries."""
        deleted = self._walk(found)
        vouched = self._leaf.length if self._leaf is not None else 0
        found.vouched += min(vouched, self.end.length)
        found.waiting += max(self.end.length - vouched, 0)
        if self._wrong(self.end.length < vouched, found, "its chain has been cut off"):
            return 0
        if self._wrong(
            deleted > vouched > 0, found, "it was deleted, and no head vouches for that"
        ):
            return 0
        matched = self._rows(deleted, registration, found)
        self._history(found)
        return matched

    def _wrong(self, is_so: bool, found: Audit, what: str) -> bool:
        if is_so:
            found.wrong.append(f"{self._twin_id}: {what}")
        return is_so

    def _blocks(self) -> Iterator[tuple[int, bytes, bytes]]:
        rows = self._reader.execute(
            f"select {', '.join(LEDGER.all_columns)} from ledger where twin = ? order by count",
            (self._twin_id,),
        )
        for row in rows:
            [(_, count, block, link)] = opened(LEDGER, [row])
            yield count, block, link

    def _walk(self, found: Audit) -> int:
        """Follow the links; give after how many entries the twin was deleted last."""
        deleted, ends, last = 0, {0}, -1
        leaf = self._leaf.length if self._leaf is not None else 0
        for count, block, link in self._blocks():
            self.end = followed(self.end, block)
            ends.add(count)
            if self._wrong(
                self.end != Link(count, link), found, f"its chain is broken at entry {count}"
            ):
                return deleted
            vouched = self._links.get(count, link.hex())
            if self._wrong(
                vouched != link.hex(), found, f"its chain is not the one vouched for at {count}"
            ):
                return deleted
            of_kind = block[::WIDTH]
            if _DELETED in of_kind:
                deleted, last = count, -1
            elif of_kind == _FEATURES * len(of_kind):
                first = int.from_bytes(block[1:9], "big")
                self._is_other |= count > leaf and first < last
                last = max(last, int.from_bytes(block[1 - WIDTH : 9 - WIDTH], "big"))
            else:
                for entry in unpacked(block):
                    if entry.kind == kinds.FEATURES:
                        self._is_other |= count > leaf and entry.key < last
                        last = max(last, entry.key)
            self._is_other |= count > leaf and (_DELETED in of_kind or _ANEW in of_kind)
        missing = sorted(self._links.keys() - ends)
        self._wrong(
            bool(missing) and self.end.length >= max(missing, default=0),
            found,
            f"its chain is not the one vouched for at {missing[:1]}",
        )
        return deleted

    def _rows(self, deleted: int, registration: str | None, found: Audit) -> int:
        """Compare registration, acknowledgements, events and features with the ledger."""
        spans = whole(self._reader, self._twin_id)
        cursors: dict[int, Iterator[bytes]] = {
            span.number: self._features(span) for span in spans
        }
        registered: Entry | None = None
        taken_note: dict[int, Entry] = {}
        told: dict[int, Entry] = {}
        matched = 0
        for count, block, _ in self._blocks():
            if count <= deleted:
                continue
            if block[:4] == block[-WIDTH : 4 - WIDTH] and block[:1] == _FEATURES:
                # One boot, nearly always: all at once, and one by one only where that fails.
                number = int.from_bytes(block[1:4], "big")
                here = list(
                    itertools.islice(cursors.get(number, iter(())), len(block) // WIDTH)
                )
                if b"".join(here) == block:
                    matched += len(here)
                    continue
                if number in cursors:
                    cursors[number] = itertools.chain(here, cursors[number])
            for at in range(0, len(block), WIDTH):
                written = block[at : at + WIDTH]
                if written[:1] == _FEATURES:
                    cursor = cursors.get(int.from_bytes(written[1:4], "big"))
                    there = next(cursor, None) if cursor is not None else None
                    if there != written:
                        self._wrong(True, found, _difference(written, there))
                        return matched
                    matched += 1
                    continue
                [entry] = unpacked(written)
                if entry.kind == kinds.REGISTRATION:
                    registered = entry
                elif entry.kind == kinds.ACKNOWLEDGEMENT:
                    taken_note.setdefault(entry.key, entry)
                elif entry.kind == kinds.ASSET_EVENT:
                    told.setdefault(entry.key, entry)
        for cursor in cursors.values():
            more = next(cursor, None)
            if more is not None:
                self._wrong(True, found, f"{_named(more)} was never accepted")
        now = None if registration is None else of_registration(registration)
        self._wrong(now != registered, found, "its registration is not the one accepted")
        self._acknowledgements(taken_note, found)
        rows = map(of_asset_event, asset_events_table.read(self._reader, self._twin_id))
        self._wrong(
            {entry.key: entry for entry in rows} != told,
            found,
            "the events that were told of it are not those that were accepted",
        )
        return matched

    def _features(self, span: Span) -> Iterator[bytes]:
        """Entries of the features of a boot as they are there, in their order."""
        first = span.first
        while rows := self._reader.execute(
            "select id, t_ns, slow_time, message from features "
            "where id between ? and ? order by id limit ?",
            (first, span.first | _LOW, _AT_ONCE),
        ).fetchall():
            for key, t_ns, slow_time, message in rows:
                digest = features_digest(span.boot, key & _LOW, t_ns, float(slow_time), message)
                yield _FEATURES + key.to_bytes(8, "big") + digest
            first = rows[-1][0] + 1

    def _acknowledgements(self, accepted: dict[int, Entry], found: Audit) -> None:
        rows = self._reader.execute(
            f"select {', '.join(ACKNOWLEDGEMENTS.all_columns)} from acknowledgements "
            "where twin = ?",
            (self._twin_id,),
        )
        here = [of_acknowledgement(row) for row in opened(ACKNOWLEDGEMENTS, rows)]
        self._wrong(
            {entry.key: entry for entry in here} != accepted,
            found,
            "its acknowledged alarms are not those that were accepted",
        )

    def _history(self, found: Audit) -> None:
        """Compare the states with the hash that the last signed head states."""
        if self._leaf is None or found.wrong:
            return
        if self._is_other:
            found.notes.append(
                f"{self._twin_id}: its states were estimated anew since the last head, which "
                "vouches for what they were made from only"
            )
            return
        rolling = RollingHash()
        for row, boot in self._stated(self._leaf.history_count):
            rolling.take(row, boot)
        self._wrong(
            (rolling.count, rolling.hexadecimal)
            != (self._leaf.history_count, self._leaf.history),
            found,
            "its states are not those that followed from what it was told",
        )

    def _stated(self, count: int) -> Iterator[tuple[HashedRow, str]]:
        """Rows of the history up to a count, with their boots."""
        some = self._reader.execute("select 1 from details limit 1").fetchone() is not None
        asked = (
            f"select f.id, message, state, {'body' if some else 'null'} from features f "
            f"{'left join details d on d.id = f.id' if some else ''} "
            "where f.id between ? and ? order by f.id limit ?"
        )
        left = count
        for span in whole(self._reader, self._twin_id):
            first = span.first
            while left > 0:
                rows = self._reader.execute(
                    asked, (first, span.first | _LOW, min(left, _AT_ONCE))
                ).fetchall()
                if not rows:
                    break
                for row in rows:
                    yield HashedRow(*row), span.boot
                left, first = left - len(rows), rows[-1][0] + 1


def _named(written: bytes) -> str:
    key = int.from_bytes(written[1:9], "big")
    return f"feature {key & _LOW} of boot number {key >> SHIFT}"


def _difference(accepted: bytes, there: bytes | None) -> str:
    if there is None or there[1:9] > accepted[1:9]:
        return f"{_named(accepted)} was accepted and is not there"
    if there[1:9] < accepted[1:9]:
        return f"{_named(there)} was never accepted"
    return f"{_named(accepted)} is not what was accepted"

"""Compares a database with its ledger, and finds rows changed, inserted, deleted or moved."""

import itertools
from collections.abc import Callable, Iterable
from typing import Any

from slowtime_services.ledger import Head
from twin_server.persist.chains.coverage import COMPOSITE, COVERED, SERVER
from twin_server.persist.tables.digests import HashedRow, RollingHash
from twin_server.persist.tables.levels import wrong_buckets
from twin_server.persist.tables.search import SHIFT, Span, whole

from .chain_walk import Seal, Walk, walk
from .column_types import wrong_types
from .counters import Counters
from .result import Audit
from .rows import compare_features, compare_states, compare_tables
from .signed_heads import Vouched, check_heads

_LOW = (1 << SHIFT) - 1


def audit(
    reader: Any,
    *,
    public: str | None = None,
    kept: Head | None = None,
    seal: Seal | None = None,
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
        A head that was kept elsewhere: the database has to have it, and what it vouches for.
    seal
        Makes authentication codes of the server's key, which what lies behind the last head
        has to carry; None for who does not have the key.
    tell
        Told the name of each chain and how many entries it has.
    """
    found = Audit(wrong=wrong_types(reader))
    if found.wrong:
        return found  # nothing more can be compared
    vouched = check_heads(reader, found, public, kept)
    features, counts, buckets = 0, dict.fromkeys(COVERED, 0), 0
    counters = Counters()
    for owner in _owners(reader, found):
        one = _ChainAudit(reader, owner, vouched, found, seal)
        if one.check():
            features += one.features
            buckets += one.buckets
            counts = {name: counts[name] + read for name, read in one.counts.items()}
        counters.take(owner, one.walked)
        if tell is not None:
            tell(owner, one.walked.end.length)
    if not found.wrong:
        _check_counts(reader, found, counts | {"features": features, "levels": buckets})
    found.wrong += counters.wrong(reader)
    if not found.heads:
        found.notes.append(
            "No head was ever signed here: give the server a key (`slowtime db ledger key`)."
        )
    return found


def _owners(reader: Any, found: Audit) -> Iterable[str]:
    """Names of all chains, and of those that rows belong to."""
    names = {row[0] for row in reader.execute("select distinct twin from ledger").fetchall()}
    names |= found.standing.leaves.keys()
    for coverage in COVERED.values():
        if coverage.owned is not None:
            column = coverage.owned.split()[0]
            begins = COMPOSITE if column == "composite" else ""
            rows = reader.execute(f"select distinct {column} from {coverage.table.name}")
            names |= {begins + row[0] or SERVER for row in rows.fetchall()}
    return sorted(names)


class _ChainAudit:
    """The audit of one chain, and of the rows that belong to it."""

    def __init__(
        self, reader: Any, owner: str, vouched: Vouched, found: Audit, seal: Seal | None
    ) -> None:
        self._reader, self._owner, self._found, self._seal = reader, owner, found, seal
        self._leaf = found.standing.leaves.get(owner)
        self._against = vouched.against.get(owner)
        is_sealed = any(leaf.tree for leaf in found.standing.leaves.values())
        self._signed = self._leaf.length if self._leaf is not None else 0
        """Number of entries that the last head covers."""
        self.walked: Walk = walk(
            reader,
            owner,
            vouched.leaves.get(owner, {}),
            self._against.length if self._against is not None else 0,
            self._signed if is_sealed else None,
            seal,
        )
        self._is_sealed = is_sealed and seal is not None
        found.ends[owner] = self.walked.end, self.walked.log
        self.features = self.buckets = 0
        self.counts: dict[str, int] = {}

    def check(self) -> bool:
        """Check chain and rows; return whether the chain was sound enough to compare rows."""
        found, walked = self._found, self.walked
        against = walked.covered
        found.vouched += min(against, walked.end.length)
        found.waiting += max(walked.end.length - against, 0)
        if walked.wrong is not None:
            found.blame(self._owner, walked.wrong)
            return False
        if self._is_unproven(walked.deleted):
            found.blame(self._owner, "it was deleted, and no head vouches for that yet")
            return False
        if self._is_unproven(walked.remade):
            found.blame(
                self._owner,
                f"its states were estimated anew at entry {walked.remade}, and no head vouches "
                "for that yet",
            )
        found.replaced += walked.replaced
        self._check_seals()
        self._check_basis(against)
        spans = whole(self._reader, self._owner)
        numbers = [span.number for span in spans]
        self.counts = compare_tables(self._reader, self._owner, walked, numbers, found)
        self.features = compare_features(self._reader, self._owner, walked, spans, found)
        compare_states(self._reader, self._owner, walked, spans, found)
        for span in spans:
            wrong, read = wrong_buckets(self._reader, span.number, span.last & _LOW)
            self.buckets += read
            found.blame_each(self._owner, (f"{what} of boot {span.boot}" for what in wrong))
        if not found.wrong:
            self._check_history(spans)
        return True

    def _is_unproven(self, entry: int) -> bool:
        """Whether an operation on all of a twin, at an entry, may be that of a stranger."""
        return entry > self._signed > 0 and not self._is_sealed and not self.walked.is_let

    def _check_seals(self) -> None:
        if self.walked.unsealed is not None:
            self._found.blame(
                self._owner,
                f"its entries up to {self.walked.unsealed}, behind the last head, carry no "
                "seal of this key: a server without it, or somebody else, has written them",
            )

    def _check_basis(self, against: int) -> None:
        """Tell what was chained anew behind the head that the audit refers to."""
        if self._against is None:
            return
        is_let = self.walked.is_let and self.walked.unsealed is None
        if self.walked.basis > against and is_let:
            return  # a server with the key has done so, as its operator said
        if self.walked.deleted > against:
            self._found.notes.append(
                f"{self._owner}: it was deleted with its history at entry "
                f"{self.walked.deleted}, behind the head"
            )
            return
        if self.walked.basis > against:
            what = (
                f"all its rows were chained anew at entry {self.walked.basis}, behind head "
                f"{self._found.against.number if self._found.against else 0}"
            )
            if self._against.tree:
                self._found.blame(self._owner, f"{what}, which vouched for others")
            else:
                self._found.notes.append(
                    f"{self._owner}: {what}, by an upgrade of the software; of what was there "
                    "before, features, registrations, acknowledgements and reports are covered"
                )
        elif self.walked.remade > against:
            self._found.notes.append(
                f"{self._owner}: its states were estimated anew at entry {self.walked.remade}, "
                "behind the head, which vouches for what they were made from only"
            )

    def _check_history(self, spans: list[Span]) -> None:
        """Compare the states with the hash of the history in a head of version 10 or older."""
        walked, leaf = self.walked, self.walked.treeless
        if leaf is None or walked.is_let or max(walked.remade, walked.deleted) > leaf.length:
            return
        if self._against is None or self._against.tree:
            return  # a later head, before whose signature the server compared all of it
        rolling = RollingHash()
        for row, boot in _stated(self._reader, spans):
            if rolling.count == leaf.history_count:
                break
            if row.key not in walked.late:
                rolling.take(row, boot)
        if (rolling.count, rolling.hexadecimal) != (leaf.history_count, leaf.history):
            self._found.blame(
                self._owner, "its states are not those that followed from what it was told"
            )


def _stated(reader: Any, spans: list[Span]) -> Iterable[tuple[HashedRow, str]]:
    """Rows of a history in order, with their boots."""
    for span in spans:
        rows = reader.execute(
            "select f.id, message, state, body from features f left join details d "
            "on d.id = f.id where f.id between ? and ? order by f.id",
            (span.first, span.last),
        )
        yield from zip(itertools.starmap(HashedRow, rows), itertools.repeat(span.boot))


def _check_counts(reader: Any, found: Audit, counts: dict[str, int]) -> None:
    """Find rows that belong to no chain, so that nothing was compared with them."""
    for name, compared in counts.items():
        there = reader.execute(f"select count(*) from {name}").fetchone()[0]
        if there != compared:
            found.wrong.append(
                f"{there - compared} rows of {name} belong to no twin and no boot that was "
                "ever accepted"
            )
    stray = reader.execute(
        "select d.id from details d left join features f on f.id = d.id where f.id is null"
    ).fetchone()
    if stray is not None:
        found.wrong.append(f"the row {stray[0]} of details belongs to no feature")

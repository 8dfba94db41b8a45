"""Follows one chain from its beginning, and finds what its last entries say of each row."""

import dataclasses
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

from slowtime_services.ledger import CompactRange, Link, MerkleLeaf, beginning, followed
from slowtime_services.ledger import chain as kinds
from slowtime_services.ledger.chain import GONE, WIDTH
from twin_server.persist.chains.coverage import COVERED, OF_KIND
from twin_server.persist.tables.checksums import DIGESTS, LEDGER, opened
from twin_server.persist.tables.counted import BITS
from twin_server.persist.tables.search import SHIFT

Seal = Callable[[bytes], bytes]

_FEATURES, _STATES, _SEAL = (
    kind.encode() for kind in (kinds.FEATURES, kinds.STATES, kinds.SEAL)
)
_ANEW, _DELETED, _BASIS = (kind.encode() for kind in (kinds.ANEW, kinds.DELETED, kinds.BASIS))
_DIGESTS = COVERED[DIGESTS.name].kind.encode()


@dataclasses.dataclass
class Walk:
    """One chain as its entries tell it.

    Parameters
    ----------
    wrong
        Why the chain itself is not sound; None if it is.
    deleted, basis, remade
        Number of entries up to the last deletion, the last basis, the last new estimation; 0
        if there was none.
    rows
        By kind and key, the digest that a row has to have, and up to which number of entries.
    states
        By boot, first feature and digest of groups of states.
    unsealed
        First block behind the last head that the server's key did not seal; None if none.
    late
        Features behind the newest leaf without a tree that came before others.
    greatest
        Greatest key of each kind of row, of removed rows as well; apart those whose key has the
        place of a twin (see `tables.counted`).
    twice
        Rows that were written again, though none of their table ever is.
    replaced
        By kind, how many rows that the head covers were written again or removed since.
    is_let
        Whether the server's key has sealed the last basis: its operator asked for it.
    """

    end: Link
    covered: int = 0
    """Number of entries that the head covers to which the audit refers."""
    treeless: MerkleLeaf | None = None
    """Newest leaf that a head of version 10 or older signed; its hash covers the states."""
    log: CompactRange = dataclasses.field(default_factory=CompactRange)
    wrong: str | None = None
    deleted: int = 0
    basis: int = 0
    remade: int = 0
    rows: dict[bytes, dict[int, tuple[bytes, int]]] = dataclasses.field(default_factory=dict)
    states: dict[int, list[tuple[int, bytes]]] = dataclasses.field(default_factory=dict)
    unsealed: int | None = None
    late: set[int] = dataclasses.field(default_factory=set)
    greatest: dict[tuple[bytes, bool], int] = dataclasses.field(default_factory=dict)
    twice: list[str] = dataclasses.field(default_factory=list)
    replaced: Counter[str] = dataclasses.field(default_factory=Counter)
    is_let: bool = False

    def void(self) -> None:
        """Forget what rows have to be, because they were deleted or chained anew."""
        self.rows.clear()
        self.states.clear()
        self.twice.clear()


def blocks(reader: Any, owner: str) -> Iterator[tuple[int, bytes, bytes]]:
    """Yield number of entries so far, entries and link of each block of a chain."""
    rows = reader.execute(
        f"select {', '.join(LEDGER.all_columns)} from ledger where twin = ? order by count",
        (owner,),
    )
    for row in rows:
        [(_, count, block, link)] = opened(LEDGER, [row])
        yield count, block, link


def walk(
    reader: Any,
    owner: str,
    leaves: dict[int, MerkleLeaf],
    covered: int,
    sealed_after: int | None,
    seal: Seal | None,
) -> Walk:
    """Follow a chain, and compare it with all leaves that were signed of it.

    Parameters
    ----------
    covered
        Number of entries that the head covers to which the audit refers.
    sealed_after
        Number of entries behind which all blocks have to be sealed; None for nowhere.
    """
    treeless = [leaf for leaf in leaves.values() if not leaf.tree]
    newest_treeless = max(treeless, key=lambda leaf: leaf.length, default=None)
    found = Walk(beginning(owner), covered, newest_treeless)
    ends, newest = {0}, max(leaves, default=0)
    last = -1
    for count, block, link in blocks(reader, owner):
        before, found.end = found.end, followed(found.end, block)
        if seal is not None:  # who signs goes on with the tree; the link proves the same
            found.log.extend(block[at : at + WIDTH] for at in range(0, len(block), WIDTH))
        ends.add(count)
        if found.end != Link(count, link) or not block:
            found.wrong = f"its chain is broken at entry {count}"
            return found
        if not _is_vouched(found, leaves.get(count), with_tree=seal is not None):
            found.wrong = f"its chain is not the one vouched for at {count}"
            return found
        last = _take(found, count, block, last)
        if seal is not None:
            is_sealed = _is_sealed(before, block, seal)
            if found.basis == count:
                found.is_let = is_sealed
            if found.is_let and found.basis == count:
                found.unsealed = None  # the operator has let it begin anew
            elif sealed_after is not None and count > sealed_after and not is_sealed:
                found.unsealed = found.unsealed or count
    missing = sorted(leaves.keys() - ends)
    if found.end.length < newest:
        found.wrong = "its chain has been cut off"
    elif missing:
        found.wrong = f"its chain is not the one vouched for at {missing[0]}"
    return found


def _is_vouched(found: Walk, leaf: MerkleLeaf | None, *, with_tree: bool) -> bool:
    if leaf is None:
        return True
    is_same = leaf.link == found.end.digest.hex()
    return is_same and (not with_tree or leaf.tree in ("", found.log.root.hex()))


def _is_sealed(before: Link, block: bytes, seal: Seal) -> bool:
    own = block[-WIDTH:]
    if own[:1] != _SEAL:
        return False
    return own[9:] == seal(followed(before, block[:-WIDTH]).digest)


def _take(found: Walk, count: int, block: bytes, last: int) -> int:
    """Note what the entries of a block say; return the id of the last feature so far."""
    is_remade = False
    is_hashed = found.treeless is None or count <= found.treeless.length
    for at in range(0, len(block), WIDTH):
        kind, key = block[at : at + 1], int.from_bytes(block[at + 1 : at + 9], "big")
        if kind == _FEATURES:
            if not is_hashed and key < last:
                found.late.add(key)
            last = max(last, key)
        elif kind == _STATES:
            digest = block[at + 9 : at + WIDTH]
            found.states.setdefault(key >> SHIFT, []).append((key, digest))
        elif kind == _DELETED:
            found.void()
            found.deleted, last = count, -1
        elif kind == _BASIS:
            found.void()
            found.basis = count
        elif kind == _ANEW:
            found.states.clear()
            found.rows.pop(_DIGESTS, None)
            found.remade, is_remade = count, True
        elif (coverage := OF_KIND.get(kind.decode("latin-1"))) is not None:
            digest = block[at + 9 : at + WIDTH]
            rows = found.rows.setdefault(kind, {})
            if coverage.is_appended and key in rows and not (digest == GONE and is_remade):
                found.twice.append(coverage.name_of_missing(key))
            if 0 < rows.get(key, (b"", 0))[1] <= found.covered < count:
                found.replaced[coverage.table.name] += 1
            rows[key] = digest, count
            of_kind = kind, key >> BITS > 0
            found.greatest[of_kind] = max(key, found.greatest.get(of_kind, 0))
    return last

"""Checks the chain of signed heads, and finds what each of them vouches for."""

import dataclasses
import json
from typing import Any

from slowtime_services.ledger import Head, MerkleLeaf, follows
from twin_server.persist.tables.ledger import heads as heads_after

from .result import Audit

_AT_ONCE = 1_000
"""Heads that are read at once."""


@dataclasses.dataclass
class Vouched:
    """What heads vouch for.

    Parameters
    ----------
    leaves
        Of each chain, all leaves that were ever signed, by the number of entries.
    against
        Leaf of each chain in the head that the audit refers to.
    """

    leaves: dict[str, dict[int, MerkleLeaf]] = dataclasses.field(default_factory=dict)
    against: dict[str, MerkleLeaf] = dataclasses.field(default_factory=dict)


def check_heads(reader: Any, found: Audit, public: str | None, kept: Head | None) -> Vouched:
    """Check all heads; the last sound one and what it signs are put into `found`."""
    vouched = Vouched()
    number, seen = 0, False
    while rows := heads_after(reader, number, _AT_ONCE, newest=False):
        for row in rows:
            number = row.number
            leaves = _take(row, found, public)
            if leaves is None:
                return vouched
            for leaf in leaves:
                vouched.leaves.setdefault(leaf.asset, {})[leaf.length] = leaf
                found.signed_ns[leaf.asset] = row.t_ns
            if kept == found.last:
                seen, vouched.against = True, dict(found.standing.leaves)
    if public is not None and found.last is not None and found.last.public != public:
        found.wrong.append(f"head {found.last.number} is not signed with the server's key")
    if kept is None:
        vouched.against, found.against = dict(found.standing.leaves), found.last
    elif seen:
        found.against = kept
    else:
        there = f"ends at head {number}" if number < kept.number else "has another there"
        found.wrong.append(
            f"head {kept.number}, which was kept elsewhere, is not in the ledger, which {there}"
        )
    return vouched


def _take(row: Any, found: Audit, public: str | None) -> list[MerkleLeaf] | None:
    """Check a head against those before; return its leaves, or None where it is not right."""
    which = f"head {row.number}"
    try:
        told = json.loads(row.body)
        head = Head.of(told["head"])
        leaves = [MerkleLeaf(*leaf) for leaf in told["leaves"]]
        found.standing.take(leaves)
        root = found.standing.root
    except (ValueError, KeyError, TypeError):
        found.wrong.append(f"{which} cannot be read")
        return None
    why = None
    if (head.number, head.t_ns) != (row.number, row.t_ns):
        why = "is another one than its row says"
    elif not head.is_signed:
        why = "is not signed with the server's key"
    elif found.last is not None and head.public != found.last.public and public is None:
        why = (
            "is signed with another key than those before; if the server was given a new one, "
            "name it"
        )
    elif not follows(head, found.last):
        why = "does not follow the one before: some are missing"
    elif (head.assets, head.root) != (len(found.standing.leaves), root):
        why = "vouches for other chains than those that stand beside it"
    if why is not None:
        found.wrong.append(f"{which} {why}")
        return None
    found.last, found.heads = head, found.heads + 1
    return leaves

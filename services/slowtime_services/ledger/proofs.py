"""Proofs in files: what `slowtime db ledger prove` fetches, verified without a server.

A proof says of one twin that its chain begins with the entries that a kept tree head covers (a
consistency proof), and, if asked, that one reading is among its entries (an inclusion proof).
Of a whole server it holds the heads that followed the one that was kept.
"""

import base64
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from .chain import FEATURES, Entry, features_digest
from .consistency import is_consistent, root_of_inclusion
from .heads import Head, follows
from .tree_heads import TreeHead

SEQUENCE_BITS = 40
"""Bits of the key of a reading that are its sequence; the number of the boot is above."""

MOST_NODES = 128
"""Hashes of a proof at most: two for each power of two of a number of entries."""

_BYTES = 32


class ProvenReading(NamedTuple):
    """A reading that is among the entries of a chain, and which of them it is."""

    entry: int
    boot: str
    sequence: int
    t_ns: int
    message: bytes


class VerifiedProof(NamedTuple):
    """What a proof has shown.

    Parameters
    ----------
    kept, head
        The head that was kept, and the newest.
    reading
        The reading that was asked for; None without one.
    """

    kept: Head | TreeHead
    head: Head | TreeHead
    reading: ProvenReading | None = None


def kept_of(told: Mapping[str, Any]) -> Head | TreeHead:
    """Read a head that was kept: of a server, or of the chain of one twin.

    Raises
    ------
    ValueError
        If it is neither.
    """
    return TreeHead.of(told) if "chain" in told else Head.of(told)


def verify(
    told: Mapping[str, Any], kept: Head | TreeHead, public: str | None = None
) -> VerifiedProof:
    """Verify a proof against a head that was kept elsewhere.

    Parameters
    ----------
    told
        The proof, as read from JSON.
    public
        Key of the server, from elsewhere; None to believe the one in the kept head.

    Raises
    ------
    ValueError
        If it proves nothing, with the reason.
    """
    try:
        if isinstance(kept, Head):
            return VerifiedProof(kept, _verify_heads(told["heads"], kept, public))
        return _verify_tree(told, kept, public)
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(
            f"It is no proof for this head: {error}. Give what `slowtime db ledger prove` "
            "wrote with the same --head."
        ) from error


def _verify_heads(told: Sequence[Mapping[str, Any]], kept: Head, public: str | None) -> Head:
    _check_signature(kept, public or kept.public)
    if not told or Head.of(told[0]) != kept:
        raise ValueError(f"the server does not have head {kept.number} as it was kept")
    last = kept
    for one in told[1:]:
        head = Head.of(one)
        _check_signature(head, public or kept.public)
        if not follows(head, last):
            raise ValueError(
                f"head {head.number} does not follow head {last.number}: the server has "
                "another history than the head that was kept"
            )
        last = head
    return last


def _verify_tree(told: Mapping[str, Any], kept: TreeHead, public: str | None) -> VerifiedProof:
    head = TreeHead.of(told["head"])
    for one in (kept, head):
        _check_signature(one, public or kept.public)
    if head.chain != kept.chain:
        raise ValueError(f"it is about {head.chain}, and the head that was kept {kept.chain}")
    nodes = _nodes(told["consistency"]["proof"])
    roots = bytes.fromhex(kept.tree), bytes.fromhex(head.tree)
    if not is_consistent(kept.size, head.size, *roots, nodes):
        raise ValueError(
            f"the chain of {head.chain}, of {head.size:,} entries, does not begin with the "
            f"{kept.size:,} that the kept head covers"
        )
    inclusion = told.get("inclusion")
    return VerifiedProof(kept, head, _reading(inclusion, head) if inclusion else None)


def _reading(told: Mapping[str, Any], head: TreeHead) -> ProvenReading:
    row = told["reading"]
    boot, sequence, t_ns, slow_time = (
        row[name] for name in ("boot", "sequence", "t_ns", "slow_time")
    )
    message = base64.b64decode(row["message"], validate=True)
    digest = features_digest(boot, sequence, t_ns, float(slow_time), message)
    entry = Entry(FEATURES, row["number"] << SEQUENCE_BITS | sequence, digest)
    nodes = _nodes(told["proof"])
    root = root_of_inclusion(told["index"], head.size, entry.written, nodes)
    if root is None or root.hex() != head.tree:
        raise ValueError(
            f"reading {sequence} of boot {boot} is not the one at entry {told['index']} of the "
            "chain"
        )
    return ProvenReading(told["index"], boot, sequence, t_ns, message)


def _check_signature(head: Head | TreeHead, public: str) -> None:
    name = f"head {head.number}" if isinstance(head, Head) else f"the head of {head.chain}"
    if head.public != public:
        raise ValueError(f"{name} is signed with another key")
    if not head.is_signed:
        raise ValueError(f"{name} is not signed with the server's key")


def _nodes(told: Sequence[str]) -> list[bytes]:
    nodes = [bytes.fromhex(one) for one in told[: MOST_NODES + 1]]
    if len(nodes) > MOST_NODES or any(len(node) != _BYTES for node in nodes):
        raise ValueError(f"a proof has at most {MOST_NODES} hashes of {_BYTES} bytes")
    return nodes

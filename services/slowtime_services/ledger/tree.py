"""Hashes of a Merkle tree (RFC 9162, section 2.1; as in RFC 6962).

Leaves and branches are hashed with different first bytes, so that no branch passes for a leaf.
"""

import hashlib
from collections.abc import Sequence


def leaf_hash(leaf: bytes) -> bytes:
    """Hash a leaf."""
    return hashlib.sha256(b"\x00" + leaf).digest()


def root(leaves: Sequence[bytes]) -> bytes:
    """Hash all leaves in their order; of none, the hash of nothing.

    Examples
    --------
    >>> root([]).hex()[:16]
    'e3b0c44298fc1c14'
    >>> root([b"a", b"b"]) == root([b"b", b"a"])
    False
    """
    row = [leaf_hash(leaf) for leaf in leaves]
    if not row:
        return hashlib.sha256().digest()
    while len(row) > 1:
        row = paired(row)
    return row[0]


def proven(leaf: bytes, path: Sequence[tuple[str, bytes]]) -> bytes:
    """Compute the root from a leaf and its audit path: the side and hash of each sibling."""
    found = leaf_hash(leaf)
    for side, other in path:
        found = branch_hash(other, found) if side == "left" else branch_hash(found, other)
    return found


def paired(row: Sequence[bytes]) -> list[bytes]:
    """Hash neighbours together; a single last one is passed up unchanged, as in RFC 6962."""
    pairs = [branch_hash(*row[at : at + 2]) for at in range(0, len(row) - 1, 2)]
    return pairs + ([row[-1]] if len(row) % 2 else [])


def branch_hash(left: bytes, right: bytes) -> bytes:
    """Hash two neighbours together."""
    return hashlib.sha256(b"\x01" + left + right).digest()

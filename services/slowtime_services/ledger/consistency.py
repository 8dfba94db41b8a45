"""Proofs that a Merkle tree holds a leaf, and that a longer tree begins with a shorter one.

A log of n entries is one hash. With a proof of about log2(n) hashes, whoever kept the hash of
its first m entries sees that none of these was changed, removed or moved since.

References
----------
RFC 9162, "Certificate Transparency Version 2.0" (2021), sections 2.1.1 to 2.1.4; the words of
the algorithms are those of the RFC.
"""

import hashlib
from collections.abc import Iterable, Sequence

from .tree import branch_hash, leaf_hash


class CompactRange:
    """Merkle tree hash of a log that grows, in memory of its logarithm.

    Examples
    --------
    >>> log = CompactRange()
    >>> log.extend([b"a", b"b", b"c"])
    >>> log.size, len(log.peaks)
    (3, 2)
    """

    def __init__(self) -> None:
        self.size = 0
        self.peaks: list[bytes] = []
        """Roots of the perfect trees that the log is made of, the largest first."""

    def copy(self) -> "CompactRange":
        """Return an independent copy."""
        other = CompactRange()
        other.size, other.peaks = self.size, self.peaks.copy()
        return other

    def extend(self, leaves: Iterable[bytes]) -> None:
        """Append leaves."""
        peaks, size = self.peaks, self.size
        for leaf in leaves:
            found, level = leaf_hash(leaf), size
            # As many trees are merged as the size ends in ones, as a binary counter carries.
            while level & 1:
                found, level = branch_hash(peaks.pop(), found), level >> 1
            peaks.append(found)
            size += 1
        self.size = size

    @property
    def root(self) -> bytes:
        """Merkle tree hash of all leaves."""
        if not self.peaks:
            return hashlib.sha256().digest()
        found = self.peaks[-1]
        for peak in reversed(self.peaks[:-1]):
            found = branch_hash(peak, found)
        return found


def consistency_proof(first: int, leaves: Sequence[bytes]) -> list[bytes]:
    """Prove that the tree over all leaves begins with the one over the first of them.

    Raises
    ------
    ValueError
        If `first` is not between 0 and the number of leaves.
    """
    if not 0 <= first <= len(leaves):
        raise ValueError(
            f"first={first} was given. Give a number of entries from 0 to {len(leaves)}."
        )
    if first in (0, len(leaves)):
        return []
    return _subproof(first, leaves, whole=True)


def is_consistent(
    first: int, second: int, first_root: bytes, second_root: bytes, proof: Sequence[bytes]
) -> bool:
    """Whether a proof shows that a tree of `second` leaves begins with one of `first`."""
    if not 0 <= first <= second:
        return False
    if first == second:
        return first_root == second_root and not proof
    if first == 0:
        return first_root == hashlib.sha256().digest() and not proof
    path = list(proof)
    if first & (first - 1) == 0:
        path.insert(0, first_root)
    if not path:
        return False
    fn, sn = first - 1, second - 1
    while fn & 1:
        fn, sn = fn >> 1, sn >> 1
    fr = sr = path[0]
    for node in path[1:]:
        if sn == 0:
            return False
        if fn & 1 or fn == sn:
            fr, sr = branch_hash(node, fr), branch_hash(node, sr)
            while not fn & 1 and fn:
                fn, sn = fn >> 1, sn >> 1
        else:
            sr = branch_hash(sr, node)
        fn, sn = fn >> 1, sn >> 1
    return sn == 0 and fr == first_root and sr == second_root


def inclusion_proof(index: int, leaves: Sequence[bytes]) -> list[bytes]:
    """Prove that the leaf at an index is in the tree over all leaves.

    Raises
    ------
    ValueError
        If there is no leaf of that index.
    """
    if not 0 <= index < len(leaves):
        raise ValueError(f"index={index} was given. Give one from 0 to {len(leaves) - 1}.")
    if len(leaves) == 1:
        return []
    at = _split(len(leaves))
    if index < at:
        return [*inclusion_proof(index, leaves[:at]), _root(leaves[at:])]
    return [*inclusion_proof(index - at, leaves[at:]), _root(leaves[:at])]


def root_of_inclusion(
    index: int, size: int, leaf: bytes, proof: Sequence[bytes]
) -> bytes | None:
    """Compute a root from a leaf and its inclusion proof; None if that is malformed."""
    if not 0 <= index < size:
        return None
    fn, sn, found = index, size - 1, leaf_hash(leaf)
    for node in proof:
        if sn == 0:
            return None
        if fn & 1 or fn == sn:
            found = branch_hash(node, found)
            while not fn & 1 and fn:
                fn, sn = fn >> 1, sn >> 1
        else:
            found = branch_hash(found, node)
        fn, sn = fn >> 1, sn >> 1
    return found if sn == 0 else None


def _subproof(first: int, leaves: Sequence[bytes], *, whole: bool) -> list[bytes]:
    if first == len(leaves):
        return [] if whole else [_root(leaves)]
    at = _split(len(leaves))
    if first <= at:
        return [*_subproof(first, leaves[:at], whole=whole), _root(leaves[at:])]
    return [*_subproof(first - at, leaves[at:], whole=False), _root(leaves[:at])]


def _split(size: int) -> int:
    """Largest power of two below a size of at least 2."""
    return 1 << (size - 1).bit_length() - 1


def _root(leaves: Sequence[bytes]) -> bytes:
    log = CompactRange()
    log.extend(leaves)
    return log.root

"""Proofs that a Merkle tree holds a leaf, and that a longer tree begins with a shorter one.

A log of n entries is one hash. With a proof of about log2(n) hashes, whoever kept the hash of
its first m entries sees that none of these was changed, removed or moved since.

References
----------
RFC 9162, "Certificate Transparency Version 2.0" (2021), sections 2.1.1 to 2.1.4; the words of
the algorithms are those of the RFC.
"""

import hashlib
from collections.abc import Callable, Iterable, Sequence

from .tree import branch_hash, leaf_hash

CHUNK_BITS = 12
"""Leaves of a chunk, whose root is kept, as a power of two: a proof hashes two chunks anew
(some 10 ms), and the roots of ten million leaves take 80 kB."""
CHUNK = 1 << CHUNK_BITS

RootOf = Callable[[int, int], bytes]
"""Gives the Merkle tree hash of the leaves from one index up to, without, another."""


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
        self.chunks: list[bytes] = []
        """Roots of each `CHUNK` leaves."""

    def copy(self) -> "CompactRange":
        """Return an independent copy."""
        other = CompactRange()
        other.size, other.peaks = self.size, self.peaks.copy()
        other.chunks = self.chunks.copy()
        return other

    def extend(self, leaves: Iterable[bytes]) -> None:
        """Append leaves."""
        peaks, size = self.peaks, self.size
        for leaf in leaves:
            found, level = leaf_hash(leaf), size
            size += 1
            is_chunk = not size & CHUNK - 1
            # As many trees are merged as the size ends in ones, as a binary counter carries.
            while level & 1:
                found, level = branch_hash(peaks.pop(), found), level >> 1
                if is_chunk and level == size - 1 >> CHUNK_BITS:
                    self.chunks.append(found)
            peaks.append(found)
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


def consistency_proof(first: int, size: int, root_of: RootOf) -> list[bytes]:
    """Prove that the tree over `size` leaves begins with the one over the first of them.

    Raises
    ------
    ValueError
        If `first` is not between 0 and the number of leaves.
    """
    if not 0 <= first <= size:
        raise ValueError(f"first={first} was given. Give a number of entries from 0 to {size}.")
    if first in (0, size):
        return []
    return _subproof(first, (0, size), root_of, whole=True)


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


def inclusion_proof(index: int, size: int, root_of: RootOf) -> list[bytes]:
    """Prove that the leaf at an index is in the tree over `size` leaves.

    Raises
    ------
    ValueError
        If there is no leaf of that index.
    """
    if not 0 <= index < size:
        raise ValueError(f"index={index} was given. Give one from 0 to {size - 1}.")
    begin, end, found = 0, size, list[bytes]()
    while end - begin > 1:
        middle = begin + _split(end - begin)
        if index < middle:
            found.append(root_of(middle, end))
            end = middle
        else:
            found.append(root_of(begin, middle))
            begin = middle
    return found[::-1]


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


def roots_over(
    chunks: Sequence[bytes], leaves: Callable[[int, int], Sequence[bytes]]
) -> RootOf:
    """Give roots of ranges as proofs need them; leaves of at most two chunks are read.

    Parameters
    ----------
    chunks
        Roots of the first leaves, `CHUNK` each.
    leaves
        Reads the leaves from one index up to, without, another.
    """

    def root_of(begin: int, end: int) -> bytes:
        chunk, is_beside = divmod(begin, CHUNK)
        if end - begin == CHUNK and not is_beside and chunk < len(chunks):
            return chunks[chunk]
        if end - begin <= CHUNK:
            log = CompactRange()
            log.extend(leaves(begin, end))
            return log.root
        middle = begin + _split(end - begin)
        return branch_hash(root_of(begin, middle), root_of(middle, end))

    return root_of


def _subproof(
    first: int, within: tuple[int, int], root_of: RootOf, *, whole: bool
) -> list[bytes]:
    begin, end = within
    if first == end:
        return [] if whole else [root_of(begin, end)]
    middle = begin + _split(end - begin)
    if first <= middle:
        return [
            *_subproof(first, (begin, middle), root_of, whole=whole),
            root_of(middle, end),
        ]
    return [*_subproof(first, (middle, end), root_of, whole=False), root_of(begin, middle)]


def _split(size: int) -> int:
    """Largest power of two below a size of at least 2."""
    return 1 << (size - 1).bit_length() - 1

"""Tamper-evident ledger: accepted rows in, hash chains and signed Merkle heads out.

Source: section 2.7 of the book, which asks for it; trees as in RFC 6962, signatures RFC 8032.
"""

from .chain import (
    Entry,
    Link,
    beginning,
    features_digest,
    followed,
    linked,
    packed,
    unpacked,
    words_digest,
)
from .heads import Head, Leaf, follows, headed
from .merkle_tree import MerkleTree
from .tree import proven, root

__all__ = [
    "Entry",
    "Head",
    "Leaf",
    "Link",
    "MerkleTree",
    "beginning",
    "features_digest",
    "followed",
    "follows",
    "headed",
    "linked",
    "packed",
    "proven",
    "root",
    "unpacked",
    "words_digest",
]

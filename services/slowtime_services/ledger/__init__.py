"""Tamper-evident ledger: accepted rows in, hash chains and signed Merkle heads out.

Source: section 2.7 of the book, which asks for it; trees and proofs as in RFC 9162, signatures
RFC 8032.
"""

from .chain import (
    Entry,
    Link,
    beginning,
    features_digest,
    followed,
    key_of,
    linked,
    packed,
    row_digest,
    states_digest,
    unpacked,
    words_digest,
)
from .consistency import (
    CompactRange,
    consistency_proof,
    inclusion_proof,
    is_consistent,
    root_of_inclusion,
    roots_over,
)
from .heads import Head, MerkleLeaf, follows, headed, last_head
from .merkle_tree import MerkleTree
from .proofs import VerifiedProof, kept_of, verify
from .tree import proven, root
from .tree_heads import TreeHead, tree_head

__all__ = [
    "CompactRange",
    "Entry",
    "Head",
    "Link",
    "MerkleLeaf",
    "MerkleTree",
    "TreeHead",
    "VerifiedProof",
    "beginning",
    "consistency_proof",
    "features_digest",
    "followed",
    "follows",
    "headed",
    "inclusion_proof",
    "is_consistent",
    "kept_of",
    "key_of",
    "last_head",
    "linked",
    "packed",
    "proven",
    "root",
    "root_of_inclusion",
    "roots_over",
    "row_digest",
    "states_digest",
    "tree_head",
    "unpacked",
    "verify",
    "words_digest",
]

"""A ledger that cannot be rewritten: rows in, a chain of hashes and signed heads over it out.

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
from .standing import Standing
from .tree import proof, proven, root

__all__ = [
    "Entry",
    "Head",
    "Leaf",
    "Link",
    "Standing",
    "beginning",
    "features_digest",
    "followed",
    "follows",
    "headed",
    "linked",
    "packed",
    "proof",
    "proven",
    "root",
    "unpacked",
    "words_digest",
]

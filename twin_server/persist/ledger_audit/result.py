"""The result of an audit."""

import dataclasses
from collections import Counter
from collections.abc import Iterable

from slowtime_services.ledger import CompactRange, Head, Link, MerkleTree

MOST_NAMED = 5
"""Rows of one twin and table that are named one by one; of more, their number is told."""


@dataclasses.dataclass
class Audit:
    """Result of comparing a database with its ledger.

    Parameters
    ----------
    wrong
        Differences from what was accepted, one sentence each; empty if there are none.
    by_chain
        The same of each chain; what belongs to none is in `wrong` only.
    heads, last
        How many signed heads there are, and the last one.
    against
        The head that the rest refers to: the one that was kept elsewhere, else the last one.
    vouched, waiting
        Number of entries that this head covers, and of those behind it.
    replaced
        By table, how many rows that this head covers were written again or removed since.
    notes
        Checks that could not be made, and why.
    standing
        Leaves that the last head signs.
    signed_ns
        Time of the head that signed each of these leaves [ns since 1970].
    ends
        End of each chain, and the Merkle tree of its entries, for who has the key.
    """

    wrong: list[str] = dataclasses.field(default_factory=list)
    by_chain: dict[str, list[str]] = dataclasses.field(default_factory=dict)
    heads: int = 0
    last: Head | None = None
    against: Head | None = None
    vouched: int = 0
    waiting: int = 0
    replaced: Counter[str] = dataclasses.field(default_factory=Counter)
    notes: list[str] = dataclasses.field(default_factory=list)
    standing: MerkleTree = dataclasses.field(default_factory=MerkleTree)
    signed_ns: dict[str, int] = dataclasses.field(default_factory=dict)
    ends: dict[str, tuple[Link, CompactRange]] = dataclasses.field(default_factory=dict)

    def blame(self, chain: str, what: str) -> None:
        """Add a difference in what belongs to one chain."""
        self.by_chain.setdefault(chain, []).append(what)
        self.wrong.append(f"{chain}: {what}")

    def blame_each(self, chain: str, sentences: Iterable[str]) -> None:
        """Add several, of which the first are told one by one."""
        several = list(sentences)
        for what in several[:MOST_NAMED]:
            self.blame(chain, what)
        if len(several) > MOST_NAMED:
            self.blame(chain, f"and {len(several) - MOST_NAMED} more rows of the same table")

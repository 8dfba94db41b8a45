"""A Merkle tree whose leaves are replaced one at a time, at the cost of one branch each."""

from collections.abc import Iterable
from typing import Literal

from . import tree
from .heads import MerkleLeaf

Side = Literal["left", "right"]


class MerkleTree:
    """Merkle tree over the leaves of all assets, in the order of their names.

    Examples
    --------
    >>> leaves = [MerkleLeaf(name, 1, "00" * 32, 0, "00" * 32) for name in ("a", "b", "c")]
    >>> merkle = MerkleTree()
    >>> merkle.take(leaves)
    >>> merkle.root == tree.root([leaf.written for leaf in leaves]).hex()
    True
    >>> merkle.take([leaves[1]._replace(length=2)])
    >>> merkle.root == tree.root([leaf.written for leaf in leaves]).hex()
    False
    >>> path = [(side, bytes.fromhex(other)) for side, other in merkle.proof("c")]
    >>> tree.proven(leaves[2].written, path).hex() == merkle.root
    True
    """

    def __init__(self) -> None:
        self.leaves: dict[str, MerkleLeaf] = {}
        self._rows: list[list[bytes]] = []
        self._place: dict[str, int] = {}

    def take(self, changed: Iterable[MerkleLeaf]) -> None:
        """Replace the leaves of the same assets, or insert new ones."""
        changed = list(changed)
        if all(leaf.asset in self._place for leaf in changed):
            for leaf in changed:
                self.leaves[leaf.asset] = leaf
                self._replace(self._place[leaf.asset], leaf)
            return
        self.leaves |= {leaf.asset: leaf for leaf in changed}
        self.leaves = dict(sorted(self.leaves.items()))
        self._place = {asset: place for place, asset in enumerate(self.leaves)}
        row = [tree.leaf_hash(leaf.written) for leaf in self.leaves.values()]
        self._rows = [row]
        while len(row) > 1:
            row = tree.paired(row)
            self._rows.append(row)

    @property
    def root(self) -> str:
        """One hash over all leaves."""
        return (self._rows[-1][0] if self._rows else tree.root([])).hex()

    def proof(self, asset: str) -> list[tuple[Side, str]]:
        """Return the audit path of an asset's leaf: side and hash of each sibling."""
        place, found = self._place[asset], list[tuple[Side, str]]()
        for row in self._rows[:-1]:
            other = place ^ 1
            if other < len(row):
                found.append(("left" if other < place else "right", row[other].hex()))
            place //= 2
        return found

    def _replace(self, place: int, leaf: MerkleLeaf) -> None:
        self._rows[0][place] = tree.leaf_hash(leaf.written)
        for below, row in zip(self._rows, self._rows[1:], strict=False):
            place //= 2
            row[place] = tree.paired(below[2 * place : 2 * place + 2])[0]

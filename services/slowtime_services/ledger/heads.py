"""Signed heads: one hash over the chains and histories of all assets.

Each head contains the hash of the head before, so that heads form a chain. A copy of one head,
kept elsewhere, therefore proves all heads before it, and reveals a chain that was cut.
"""

import hashlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, Self

from slowtime_services.credentials import Signer, is_signed
from slowtime_services.documents.json_documents import read_json

from .chain import Link

_NOTHING = "0" * 64

LONGEST_LINE = 4_096
"""Longest line of a file of heads [bytes]; a head has some 500."""


class Leaf(NamedTuple):
    """Leaf of the Merkle tree: the state of one asset's chain and history."""

    asset: str
    length: int
    """Entries of its chain."""
    link: str
    """End of its chain."""
    history_count: int
    history: str
    """SHA-256 of so many rows with the states they led to, as `GET .../history/hash` tells."""
    tree: str = ""
    """Merkle tree hash (RFC 9162) of the entries of its chain; empty before version 11 of the
    database, whose chains covered features, registrations and reports only."""

    @property
    def written(self) -> bytes:
        """Bytes that are hashed."""
        return "\n".join(map(str, self if self.tree else self[:5])).encode()

    @property
    def end(self) -> Link:
        """End of the chain, in the form of `chain`."""
        return Link(self.length, bytes.fromhex(self.link))


class Head(NamedTuple):
    """A signed hash over all assets at one moment."""

    number: int
    t_ns: int
    assets: int
    root: str
    previous: str
    public: str
    signature: str

    @property
    def said(self) -> bytes:
        """Bytes that are signed."""
        words = ("slowtime head 1", *self[:6])
        return "\n".join(map(str, words)).encode()

    @property
    def hashed(self) -> bytes:
        """Bytes whose hash is `digest`."""
        return self.said + self.signature.encode()

    @property
    def digest(self) -> str:
        """Hash by which the next head refers to it."""
        return hashlib.sha256(self.hashed).hexdigest()

    @property
    def is_signed(self) -> bool:
        """Whether the key that it names has signed it; the key itself is checked elsewhere."""
        return is_signed(self.said, self.signature, self.public)

    @classmethod
    def of(cls, told: Mapping[str, Any]) -> Self:
        """Read one from JSON.

        Raises
        ------
        ValueError
            If a part is missing or of another kind.
        """
        try:
            found = cls(**{name: told[name] for name in cls._fields})
        except KeyError as error:
            raise ValueError(f"A head lacks {error}.") from error
        numbers, words = found[:3], found[3:]
        if not all(type(n) is int for n in numbers) or not all(
            isinstance(word, str) for word in words
        ):
            raise ValueError(
                "Of a head, number, t_ns and assets are integers, the rest is text."
            )
        return found


def headed(root: str, assets: int, before: Head | None, t_ns: int, signer: Signer) -> Head:
    """Sign the ends of all chains.

    Parameters
    ----------
    root
        Hash over the leaves of so many assets (see `MerkleTree`).
    before
        The head before; None for the first.
    """
    number, previous = (1, _NOTHING) if before is None else (before.number + 1, before.digest)
    unsigned = Head(number, t_ns, assets, root, previous, signer.public, "")
    return unsigned._replace(signature=signer.sign(unsigned.said))


def follows(head: Head, before: Head | None) -> bool:
    """Whether a head is the one right after another, or the first."""
    if before is None:
        return head.number == 1 and head.previous == _NOTHING
    return (
        head.number == before.number + 1
        and head.previous == before.digest
        and head.t_ns >= before.t_ns
    )


def last_head(path: Path) -> Head:
    """Read the last head of a file of heads, one JSON object a line.

    Raises
    ------
    ValueError
        If it does not end with a head.
    """
    with path.open("rb") as file:
        file.seek(0, os.SEEK_END)
        file.seek(max(0, file.tell() - LONGEST_LINE))
        lines = file.read(LONGEST_LINE).splitlines()
    if not lines:
        raise ValueError(f"{path} holds no head.")
    return Head.of(read_json(lines[-1]))

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
"""End of a file of heads that is searched for the last one [bytes]; a head has some 500."""


class MerkleLeaf(NamedTuple):
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
        return cls(**read_fields("head", cls.__annotations__, told))


def read_fields(
    what: str, types: Mapping[str, type], told: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the parts of a head that JSON tells.

    Raises
    ------
    ValueError
        If a part is missing or of another type.
    """
    for name, kind in types.items():
        if name not in told:
            raise ValueError(f"A {what} lacks {name!r}.")
        if type(told[name]) is not kind:
            words = "an integer" if kind is int else "text"
            raise ValueError(f"Of a {what}, {name} is {words}.")
    return {name: told[name] for name in types}


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

    A line that is no head was being written when its volume was full or its machine failed; the
    head before it counts. Whoever could spoil a line could remove it as well.

    Raises
    ------
    ValueError
        If there is no head among the last lines.
    """
    with path.open("rb") as file:
        file.seek(0, os.SEEK_END)
        file.seek(max(0, file.tell() - LONGEST_LINE))
        lines = file.read(LONGEST_LINE).splitlines()
    why: ValueError | TypeError = ValueError("it is empty")
    for line in reversed(lines):
        try:
            return Head.of(read_json(line))
        except (ValueError, TypeError) as error:
            why = error
    raise ValueError(f"{path} holds no head: {why}")
